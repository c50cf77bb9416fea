"""What pictures hold: the texts of an SVG file, the content of a page."""

from __future__ import annotations

import json
import re


def drawn_texts(path):
    """Return the texts of an SVG file of Matplotlib, which writes each beside the outlines of its letters."""
    return set(re.findall(r"<!-- (.+?) -->", path.read_text(encoding="utf-8")))


def content_of(page):
    """Return the model and the motion that a page holds."""
    return json.loads(re.search(r'<script id="content" type="application/json">(.*?)</script>', page.html)[1])
