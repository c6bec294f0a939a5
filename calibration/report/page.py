"""`report.html`: the words of `report.md` as one file that any browser opens and prints."""

import base64
import html
from pathlib import Path

FRAME = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}</body>
</html>
"""
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 60rem;
  margin: 0 auto; padding: 1rem; overflow-wrap: break-word; }
h1, h2 { line-height: 1.25; break-after: avoid; }
h2 { margin-top: 2rem; border-bottom: 1px solid #ccc; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid #ddd; padding: .25rem .8rem .25rem 0; text-align: left; white-space: nowrap; }
th { border-bottom: 2px solid #888; }
figure { margin: 1.5rem 0; break-inside: avoid; }
img { max-width: 100%; }
figcaption { color: #555; font-size: .9rem; }
code { font-size: .9em; background: #f4f4f4; overflow-wrap: anywhere; }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  .wide { overflow: visible; }
  table { font-size: 7.5pt; }
  th, td { white-space: normal; }
  tr { break-inside: avoid; }
}
"""


def html_report(text: str, folder: Path) -> str:
    """A Markdown report as one page with its pictures inside.

    Args:
        text: of `markdown_report`. HTML in it is shown as it stands, and acts as none.
        folder: where the pictures are.
    """
    import mistune

    class Renderer(mistune.HTMLRenderer):
        """A picture with its caption stands by itself; a table may be wider than the page."""

        def text(self, text: str) -> str:
            return html.escape(html.unescape(text))  # names come as entities

        def image(self, text: str, url: str, title: str | None = None) -> str:
            if url not in pictures:
                return text
            coded = base64.b64encode((folder / url).read_bytes()).decode("ascii")
            caption = f"<figcaption>{text}</figcaption>"
            return f'<figure><img alt="" src="data:image/png;base64,{coded}">{caption}</figure>'

        def paragraph(self, text: str) -> str:
            whole = text.startswith("<figure>") and text.endswith("</figure>")
            return f"{text}\n" if whole else super().paragraph(text)

        def table(self, text: str) -> str:
            return f'<div class="wide"><table>\n{text}</table></div>\n'

    # a picture that a name of the data asks for is none of the report's
    pictures = {path.name for path in folder.glob("*.png")}
    body = mistune.create_markdown(renderer=Renderer(escape=True), plugins=["table"])(text)
    title = mistune.escape(text.partition("\n")[0].removeprefix("# "))
    return FRAME.format(title=title, style=STYLE, body=body)
