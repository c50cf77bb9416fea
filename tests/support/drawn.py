"""The texts of a picture in the format SVG."""

from __future__ import annotations

import re


def drawn_texts(path):
    """Return the texts of an SVG file of Matplotlib, which writes each beside the outlines of its letters."""
    return set(re.findall(r"<!-- (.+?) -->", path.read_text(encoding="utf-8")))
