"""Hook of mkdocs: equations in fences called ``math`` become MathML, which needs no script."""

from __future__ import annotations

import re
from typing import Any

_FENCE = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with its equations typeset; mkdocs calls this for each page."""
    return _FENCE.sub(lambda match: typeset(match[1]), markdown)


def typeset(latex: str) -> str:
    """Return an equation as MathML in a block of its own."""
    from latex2mathml.converter import convert

    return f'<div class="equation">\n{convert(latex, display="block")}\n</div>'
