"""What MkDocs calls while it builds the site: adds pages that are written elsewhere, and mends links."""

import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tools.website import commands, links, lists, reference  # noqa: E402

ASSETS = ("iframe-worker.js", "site.css")
SOURCES = {page: source for source, page in links.PAGES.items()}
"""Pages of the site that are files beside ``docs``, and which."""


def on_config(config: Any) -> Any:
    """Puts the pages of commands into the navigation."""
    for entry in config.nav:
        if entry.get("Commands") == "commands":
            entry["Commands"] = commands.navigation()
    return config


def on_files(files: Any, config: Any) -> Any:
    """Adds pages and assets that do not stand in ``docs``."""
    texts = {page: (ROOT / source).read_text(encoding="utf-8") for page, source in SOURCES.items()}
    for page, text in {**texts, **reference.all_pages(ROOT), **commands.all_pages()}.items():
        files.append(File.generated(config, page, content=text))
    for name in ASSETS:
        files.append(File.generated(config, f"website/{name}", abs_src_path=str(Path(__file__).with_name(name))))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links and lists as they are on GitHub become those of the site."""
    path = page.file.src_uri
    source = SOURCES.get(path, f"docs/{path}")
    if path == "index.md":
        page.meta["hide"] = ["navigation"]  # of one page, which leaves its width to pictures
    return lists.lists_apart(links.links_of_site(markdown, source, path))
