"""What pyproject.toml cannot say: README with absolute links, for package indexes, which show it alone."""

import re
from pathlib import Path

REPOSITORY = "seeing-by-moving/seeing-by-moving/main"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)]+)\)")


def absolute_links(markdown: str) -> str:
    """The text with links to files of the repository as addresses; of pictures as those of the files themselves."""
    owner, name, branch = REPOSITORY.split("/")

    def absolute(link: re.Match[str]) -> str:
        mark, text, target = link.groups()
        page = f"https://github.com/{owner}/{name}/blob/{branch}/"
        return f"{mark}[{text}]({f'https://raw.githubusercontent.com/{REPOSITORY}/' if mark else page}{target})"

    return _LINK.sub(absolute, markdown)


if __name__ == "__main__":
    from setuptools import setup

    setup(
        long_description=absolute_links(Path(__file__).with_name("README.md").read_text(encoding="utf-8")),
        long_description_content_type="text/markdown",
    )
