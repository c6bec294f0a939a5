"""A fit in words and tables: on a terminal, as Markdown and as one web page."""
