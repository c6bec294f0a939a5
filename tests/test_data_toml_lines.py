"""The line of each key of a TOML text, counted by eye, and how deep a text may go."""

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from calibration.data.toml_lines import DEEPEST, lines_of, too_deep

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


# one statement each, with the keys it defines below a name that is put in
SNIPPETS = [
    ("{0} = 1", ["{0}"]),
    ('{0} = """\n[x]\ny = 1 # "\n\\""" \\\\"""', ["{0}"]),
    ("{0} = '''\n''[[y]]\n''''", ["{0}"]),
    ('{0} = "a # b = [ \\" {{" # "open', ["{0}"]),
    ("{0} = 'c:\\' # '", ["{0}"]),
    ("{0} = [ # ]\n  [1, 2], '\\', # [\n  {{ a = 1 }},\n]", ["{0}"]),
    ("{0} = {{ a = 1, b.c = [\n1] }}", ["{0}", "{0}.a", "{0}.b", "{0}.b.c"]),
    ('{0} . "k.k" = 1.5e3', ["{0}", "{0}.k.k"]),
    ("  {0}\t= 1979-05-27T07:32:00.5Z", ["{0}"]),
    ('"{0}" = ""', ["{0}"]),
    ("'{0}' = ''''''", ["{0}"]),
    ("# {0} = [", []),
    ("   ", []),
]


@given(st.lists(st.sampled_from(SNIPPETS), max_size=12))
def test_any_sequence_of_statements(snippets):
    text, expected = "", {}
    for i, (snippet, paths) in enumerate(snippets):
        line = text.count("\n") + 1
        expected |= dict.fromkeys((path.format(f"key{i}") for path in paths), line)
        text += snippet.format(f"key{i}") + "\n"
    tomllib.loads(text)
    assert {".".join(path): line for path, line in lines_of(text).items()} == expected
    assert too_deep(text) is None


def test_what_is_too_deep_for_the_parser():
    for opening, closing in (("[", "]"), ("{a=", "}")):
        text = "x = 1\ny = " + opening * DEEPEST + "1" + closing * DEEPEST
        tomllib.loads(text)
        assert too_deep(text) is None
        assert too_deep(text.replace("1" + closing, f"{opening}1{closing}{closing}")) == 2
    assert too_deep("\n" + ".".join("a" * DEEPEST) + " = 1") is None
    assert too_deep("\n" + ".".join("a" * (DEEPEST + 2)) + " = 1") == 2
    assert too_deep("[" + ".".join("a" * (DEEPEST + 2)) + "]") == 1
    # numbers, texts and comments are not deep
    many = "[." * 200
    assert too_deep("a = [" + "1.5, " * 200 + "]") is None
    assert too_deep(f'a = "{many}"\n# {many}\nb = \'{many}\'\nc = """\n{many}\n') is None
