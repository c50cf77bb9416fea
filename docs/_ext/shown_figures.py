"""Figures of the gallery appear where their script shows them, not after each block that draws on them."""

from __future__ import annotations

from typing import Any

from sphinx_gallery.scrapers import matplotlib_scraper


def scrape(block: tuple[str, str, int], block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Return the reStructuredText of the figures that a block of a script shows by `plt.show()`."""
    return matplotlib_scraper(block, block_vars, gallery_conf) if "plt.show()" in block[1] else ""
