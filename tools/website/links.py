"""Links of Markdown files of the repository, as they lead from a page of the site."""

import posixpath
import re

REPOSITORY = "https://github.com/seeing-by-moving/seeing-by-moving/blob/main/"
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Files beside ``docs`` that are pages of the site."""
_CODE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(\]\()(?![a-z]+:|#)([^)\s#]+)")


def links_of_site(markdown: str, source: str, page: str) -> str:
    """The text with its links to files of the repository as links of the site.

    Args:
        markdown: text of a page; code in it is left as it is.
        source: the file that the text stands in, from the root of the repository, such as ``docs/worlds.md``.
        page: the page that it becomes, from the root of the site, such as ``worlds.md``.

    Returns:
        The text, in which links to files under ``docs`` and to those in ``PAGES`` lead to pages, all others to the
        repository.

    >>> links_of_site("[worlds](docs/worlds.md), [licence](LICENSE)", "README.md", "index.md")
    '[worlds](worlds.md), [licence](https://github.com/seeing-by-moving/seeing-by-moving/blob/main/LICENSE)'
    """

    def moved(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), link[2]))
        if target not in PAGES and not target.startswith("docs/"):
            return f"{link[1]}{REPOSITORY}{target}"
        target = PAGES.get(target, target.removeprefix("docs/"))
        return link[1] + posixpath.relpath(target, posixpath.dirname(page) or ".")

    parts = _CODE.split(markdown)
    # Every second part is code; but [`code`](target) is a link around code, which is put together first.
    kept = {f"\0{number}\0": part for number, part in enumerate(parts) if number % 2}
    text = "".join(f"\0{number}\0" if number % 2 else part for number, part in enumerate(parts))
    return re.sub(r"\0\d+\0", lambda found: kept[found[0]], _LINK.sub(moved, text))
