"""The page of an evaluation: one HTML file beside its pictures, without anything from the network."""

from collections.abc import Sequence
from html import escape

_STYLE = """
body { font-family: sans-serif; margin: 2em auto; max-width: 75em; color: #222; }
table { border-collapse: collapse; } th, td { padding: .3em .8em; border-bottom: 1px solid #ccc; text-align: right; }
th:first-child, td:first-child { text-align: left; } img { max-width: 100%; }
"""


def report_page(title: str, columns: Sequence[str], lines: Sequence[Sequence[str]], notes: Sequence[str]) -> str:
    """An HTML page of a table, notes, ``curve.png`` and ``worst.jpg``; every text is escaped."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "\n".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in line) + "</tr>" for line in lines)
    listed = "\n".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style></head><body>
<h1>{escape(title)}</h1>
<table><thead><tr>{head}</tr></thead><tbody>
{body}
</tbody></table>
<ul>
{listed}
</ul>
<h2>Error curve</h2><p><img src="curve.png" alt="Cumulative error distribution"></p>
<h2>Worst cases</h2><p>Green: true landmarks. Red: fitted landmarks.</p>
<p><img src="worst.jpg" alt="The faces with the largest errors"></p>
</body></html>
"""
