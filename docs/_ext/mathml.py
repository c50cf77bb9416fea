"""Formulas as MathML, made when the pages are built: they need neither scripts nor a network."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging


def _mathml(node: nodes.Element, *, as_block: bool) -> str:
    try:
        return tex2mathml(node.astext(), as_block=as_block)
    except MathError as error:
        logging.getLogger(__name__).warning("formula: %s", error, location=node)
        return ""


def visit_math(translator: Any, node: nodes.Element) -> None:
    """Write a formula within a line."""
    translator.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def visit_displaymath(translator: Any, node: nodes.Element) -> None:
    """Write a formula on lines of its own, with its label as its number."""
    label = node.get("label")
    anchor = f' id="{label}"' if label else ""
    number = f'<a class="eqno" href="#{label}">({label})</a>' if label else ""
    translator.body.append(f'<div class="math"{anchor}>{number}{_mathml(node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def setup(sphinx: Any) -> dict[str, bool]:
    """Register the renderer with Sphinx."""
    sphinx.add_html_math_renderer("mathml", (visit_math, None), (visit_displaymath, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
