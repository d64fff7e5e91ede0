"""Usage: check_links.py SITE: name every link of a website within itself that leads nowhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """Links of a page, and the places in it that links can name."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places = {"top"}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take what names a place or another file."""
        for name, value in attrs:
            if value is not None and name in ("id", "name"):
                self.places.add(value)
            elif value is not None and name in ("href", "src"):
                self.links.append(value)


def broken_links(site: Path) -> Iterator[str]:
    """``page: link`` for each link without a scheme whose file or place there is not."""
    page = cache(Page)
    for path in sorted(site.rglob("*.html")):
        for link in page(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            place = unquote(parts.fragment) if target.suffix == ".html" else ""
            if not target.is_file() or (place and place not in page(target).places):
                yield f"{path.relative_to(site)}: {link}"


def main(site: Path) -> int:
    """Name them; 1 if there are any, or no page at all."""
    pages = len(list(site.rglob("*.html")))
    broken = list(broken_links(site))
    print("\n".join([*broken, f"{len(broken)} broken links on {pages} pages"]))
    return int(bool(broken) or not pages)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
