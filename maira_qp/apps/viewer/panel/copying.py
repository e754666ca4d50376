"""Lines that can be copied: a name, the text, and a button that puts it into the clipboard of the browser.

A page has a clipboard where it is served from this machine or encrypted; elsewhere the text is selected and copied as
Ctrl-C would.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

QUIET = "#5c6670"
_COPY = (
    "const f=this.previousElementSibling;f.select();"
    "if(navigator.clipboard){navigator.clipboard.writeText(f.value)}else{document.execCommand('copy')}"
    "this.textContent='Copied';setTimeout(()=>this.textContent='Copy',1200)"
)


def copied_lines(lines: Sequence[tuple[str, str]]) -> str:
    """HTML of lines (name, text)."""
    return f'<div style="padding:0.2em 0.75em 0.5em">{"".join(_line(name, text) for name, text in lines)}</div>'


def _line(name: str, text: str) -> str:
    name, text = escape(name), escape(text)
    field = (
        f'<input readonly aria-label="{name}" value="{text}" onclick="this.select()" style="flex:1;min-width:0;'
        'border:1px solid #ced4da;border-radius:3px;padding:0.2em 0.4em;font-size:1em;color:inherit;background:none">'
    )
    button = (
        f'<button type="button" aria-label="Copy {name}" onclick="{_COPY}" style="width:4.5em;cursor:pointer;'
        'border:1px solid #ced4da;border-radius:3px;background:#f1f3f5;color:#212529;font-size:1em">Copy</button>'
    )
    return (
        f'<div style="font-size:0.8em;color:{QUIET};margin-top:0.3em">{name}</div>'
        f'<div style="display:flex;gap:0.3em;font-size:0.8em">{field}{button}</div>'
    )
