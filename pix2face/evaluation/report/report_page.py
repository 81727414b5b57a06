"""The page of an evaluation: one HTML file that needs nothing beside it and nothing from the network."""

from base64 import b64encode
from collections.abc import Sequence
from html import escape

_STYLE = """
body { font-family: sans-serif; margin: 2em auto; max-width: 75em; color: #222; line-height: 1.4; }
table { border-collapse: collapse; margin-bottom: 1.2em; }
th, td { padding: .3em .8em; border-bottom: 1px solid #ccc; text-align: right; }
th:first-child, td:first-child { text-align: left; } img, svg { max-width: 100%; height: auto; }
"""

Section = tuple[str, str, str]


def table_html(columns: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table; every text is escaped."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "\n".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in line) + "</tr>" for line in lines)
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table>"


def picture_html(content: bytes, kind: str, description: str) -> str:
    """A picture with its content in the page."""
    data = b64encode(content).decode("ascii")
    return f'<img src="data:image/{kind};base64,{data}" alt="{escape(description)}">'


def report_page(
    title: str,
    tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]],
    notes: Sequence[str],
    sections: Sequence[Section],
) -> str:
    """An HTML page.

    Args:
        title: Plain text.
        tables: Headings and lines of each, plain text.
        notes: Plain text, a line each.
        sections: For each its heading and a sentence in plain text, and its content as HTML.
    """
    shown = "\n".join(table_html(columns, lines) for columns, lines in tables)
    listed = "\n".join(f"<li>{escape(note)}</li>" for note in notes)
    parts = "\n".join(
        f"<h2>{escape(heading)}</h2><p>{escape(sentence)}</p><p>{content}</p>"
        for heading, sentence, content in sections
    )
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style></head><body>
<h1>{escape(title)}</h1>
{shown}
<ul>
{listed}
</ul>
{parts}
</body></html>
"""
