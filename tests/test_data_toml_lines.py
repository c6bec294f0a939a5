"""The line of each key of a TOML text, counted by eye."""

import tomllib

from calibration.toml_lines import lines_of

NASTY = '''\
# a comment with [brackets] and key = value

title = """
[material]
name = "not a key"
"""
"quoted key" . inner = [
    1, # density = 3
    2,
]
inline = { a = 1, b = { c = "x = 1" } }
[[material]]
name = 'first'
[material.wall]
density = 1
[material.parameters.sigma]
value = 1
[[material]]

[material."odd.name"] # [[x]]
key = """one line"""
[[material.rows]]
x = 1
[[material.rows]]
x = 2
'''


def test_lines_of_keys():
    lines = lines_of(NASTY)
    assert lines == {
        ("title",): 3,
        ("quoted key",): 7,
        ("quoted key", "inner"): 7,
        ("inline",): 11,
        ("inline", "a"): 11,
        ("inline", "b"): 11,
        ("inline", "b", "c"): 11,
        ("material", 0): 12,
        ("material", 0, "name"): 13,
        ("material", 0, "wall"): 14,
        ("material", 0, "wall", "density"): 15,
        ("material", 0, "parameters", "sigma"): 16,
        ("material", 0, "parameters", "sigma", "value"): 17,
        ("material", 1): 18,
        ("material", 1, "odd.name"): 20,
        ("material", 1, "odd.name", "key"): 21,
        ("material", 1, "rows", 0): 22,
        ("material", 1, "rows", 0, "x"): 23,
        ("material", 1, "rows", 1): 24,
        ("material", 1, "rows", 1, "x"): 25,
    }


def test_each_line_found_leads_to_a_value():
    parsed = tomllib.loads(NASTY)
    for path in lines_of(NASTY):
        value = parsed
        for part in path:
            value = value[part]  # raises where the path is none of the file's
