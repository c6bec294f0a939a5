"""A fit in words and tables: on a terminal and as one web page."""
