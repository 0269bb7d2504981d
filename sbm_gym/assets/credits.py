"""Who made the furniture: the attribution that the models' licences ask for."""

from sbm_gym.assets.catalog.library import Home3dLibrary, ModelCard


def credits_text(library: Home3dLibrary) -> str:
    """The attribution file of all models that worlds use, as Markdown."""
    lines = [
        "# Furniture credits",
        "",
        "Worlds of sbm_gym show furniture from Sweet Home 3D libraries. The models were converted: scaled to the",
        "catalogue's sizes, turned, and their pictures shrunk; shapes and colours were not changed.",
    ]
    for source in library.libraries:
        cards = sorted({card.model_id: card for card in library.cards() if card.library == source.name}.items())
        if not cards:
            continue
        lines += ["", f"## {source.name}", "", f"Licence: {source.licence} (file `{source.path.name}`)", ""]
        lines += [_line(card, source.licence) for _, card in cards]
        if source.licence_text.strip():
            text = source.licence_text.replace("\r\n", "\n").strip()
            lines += ["", "The library's own licence note:", "", *[f"> {line}".rstrip() for line in text.split("\n")]]
    return "\n".join(lines) + "\n"


def _line(card: ModelCard, licence: str) -> str:
    own = f"; {card.licence}" if card.licence != licence else ""
    return f"- {card.name} (`{card.model_id}`) by {card.creator}{own}"
