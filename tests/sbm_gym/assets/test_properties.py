from hypothesis import given
from hypothesis import strategies as st

from sbm_gym.assets.catalog.properties import parse_properties


def escape(text: str) -> str:
    """Writes a text as Java's ``Properties.store`` does."""
    out = []
    for character in text:
        if character in "\\=:#! ":
            out.append("\\" + character)
        elif character in "\t\n\r\f":
            out.append({"\t": "\\t", "\n": "\\n", "\r": "\\r", "\f": "\\f"}[character])
        elif 0x20 < ord(character) < 0x7F:
            out.append(character)
        else:
            out += [f"\\u{unit:04x}" for unit in _utf16(character)]
    return "".join(out)


def _utf16(character: str) -> list[int]:
    encoded = character.encode("utf-16-be")
    return [int.from_bytes(encoded[i : i + 2], "big") for i in range(0, len(encoded), 2)]


plain = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=("Cs",)), min_size=1, max_size=20)


@given(st.dictionaries(plain, plain, max_size=8))
def test_what_java_writes_is_read_back(properties):
    text = "".join(f"{escape(key)}={escape(value)}\n" for key, value in properties.items())
    assert parse_properties(text.encode("iso-8859-1")) == properties


def test_separators_comments_continuations_and_latin_letters():
    content = (
        b"# c = d\n  ! also\n\na=1\nb : 2\nc 3\nd\ne = one \\\n   two\r\nname#2=Caf\xe9 \\u20ac\nf=x\\\\\ng=y\na=last"
    )
    assert parse_properties(content) == {
        "a": "last",
        "b": "2",
        "c": "3",
        "d": "",
        "e": "one two",
        "name#2": "Café €",
        "f": "x\\",
        "g": "y",
    }
