"""What notebooks show."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import dscene


def test_images_are_pictures(shadow: dscene.Script) -> None:
    image = shadow.eval("image([[[0, 0.5, 1], [1, 1, 1]]])")
    png = image._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert struct.unpack(">II", png[16:24]) == (2, 1)
    # What is computed from it is a plain array; a part of it is a picture as well.
    assert type(image * 2) is np.ndarray
    assert isinstance(image[:, :1], dscene.Image)
    assert isinstance(image.mean(), float)
    assert image[0]._repr_png_() is None
    assert zlib.crc32(png[12:29]) == struct.unpack(">I", png[29:33])[0]


def test_params_and_gradients_are_tables(shadow: dscene.Script) -> None:
    table = shadow.params._repr_html_()
    assert "<td>corners</td>" in table
    assert "Four corners of a plate." in table
    found = shadow.grad("mean(render(eye, spp: 1))", wrt=["glow"], repeats=3, fd=True)
    assert "<td>glow</td>" in found._repr_html_()
    assert "±" in found._repr_html_()
    assert "glow" in str(found)
    assert found["glow"].std_error >= 0


def test_cells_are_scripts(capsys: pytest.CaptureFixture[str], optional: Callable[[str], Any]) -> None:
    interactive = optional("IPython.core.interactiveshell")
    shell = interactive.InteractiveShell.instance()
    shell.run_line_magic("load_ext", "dscene")
    shell.run_cell_magic("dscene", "bowl --set x=5", "param x = 3\nloss l = x ^ 2\noptimize l { steps: 5 }")
    assert shell.user_ns["bowl"].eval("x") == 5
    shell.run_cell_magic("dscene", "other --optimize l --steps 2", "param x = 3\nloss l = x ^ 2\noptimize l { steps: 5 }")
    assert shell.user_ns["other"].eval("x") < 3
    capsys.readouterr()
    shell.run_cell_magic("dscene", "wrong", "let a = b")
    assert "dscene::name::unknown" in capsys.readouterr().err
    assert "wrong" not in shell.user_ns
    shell.run_cell_magic("dscene", "--no-such", "let a = 1")
    assert "usage: %%dscene" in capsys.readouterr().err


ROOT = Path(__file__).parents[2]


def test_scripts_have_colours(optional: Callable[[str], Any]) -> None:
    pygments = optional("pygments")
    from pygments.lexers import get_lexer_by_name, get_lexer_for_filename
    from pygments.token import Comment, Error, Keyword, Name, Number, String

    # It is found by name and by extension, as Sphinx and nbconvert look for it.
    lexer = get_lexer_by_name("dscene")
    assert type(get_lexer_for_filename("a.dscene")) is type(lexer)
    scripts = [*ROOT.glob("examples/*.dscene"), *ROOT.glob("stdlib/*.dscene"), *ROOT.glob("docs/book/scripts/**/*.dscene")]
    assert len(scripts) > 40
    for script in scripts:
        text = script.read_text()
        tokens = list(pygments.lex(text, lexer))
        wrong = [value for kind, value in tokens if kind in Error]
        assert not wrong, f"{script}: {wrong}"
        assert "".join(value for _, value in tokens).strip() == text.strip()
    text = 'param glow = 45deg in 0..1 // why\nprint "x is {glow:.3}", eye.camera, mean(a)'
    kinds = {value: kind for kind, value in pygments.lex(text, lexer)}
    expected = {
        "param": Keyword.Declaration,
        "glow": Name.Variable,
        "45": Number,
        "deg": Keyword.Type,
        "in": Keyword,
        "// why": Comment.Single,
        "x is ": String.Double,
        "{glow:.3}": String.Interpol,
        "camera": Name.Attribute,
        "mean": Name.Function,
    }
    assert {word: kinds[word] for word in expected} == expected


def words_of_the_language() -> set[str]:
    """All words that the grammar reads as more than names: in its rules they end where no letter follows, and names exclude those reserved."""
    rules = dict(re.findall(r"^(\w+) *= *(.+(?:\n +.+)*)", (ROOT / "grammar" / "dscene.pest").read_text(), re.MULTILINE))
    assert {"reserved", "kind", "infix", "kw_let"} <= set(rules)
    ends = [rule for rule in rules.values() if "!word_char" in rule]
    words = {word for rule in ends for word in re.findall(r'"([a-z]{2,})"', rule)}
    # By their first letters: `"a" ~ ("nd" | "s")`.
    for first, rest in re.findall(r'"(\w+)"(?: ~ \(([^)]*)\))?', rules["reserved"]):
        words |= {first + end for end in re.findall(r'"(\w+)"', rest)} or {first}
    return words


def test_colours_know_every_word_of_the_language(optional: Callable[[str], Any]) -> None:
    pygments = optional("pygments")
    from pygments.token import Keyword, Operator

    from dscene import _highlight

    lexer = _highlight.DsceneLexer()

    def is_word(word: str) -> bool:
        """Whether it has the colour of a word of the language before a name or, as `test` has, before a text."""
        found = [next(iter(pygments.lex(f"{word} {behind}", lexer))) for behind in ("a", '"a"')]
        return any(value == word and (kind in Keyword or kind in Operator.Word) for kind, value in found)

    words = words_of_the_language()
    assert {"as", "let", "true", "camera", "within", "test", "over", "sweep"} <= words
    assert not {word for word in words if not is_word(word)}
    # What looks like one is a name.
    assert not {word for word in words if is_word(f"{word}s")} - {"as"}
    # The lexer has no words of its own but `none`, which is a name of the library.
    known = set(re.findall(r"[a-z_]+", Path(_highlight.__file__).read_text()))
    assert {word for word in known if is_word(word)} - words == {"none"}


def test_colours_know_every_type(optional: Callable[[str], Any]) -> None:
    pygments = optional("pygments")
    from pygments.token import Keyword

    from dscene import _highlight

    (body,) = re.findall(r"pub fn named\(.*?\n}", (ROOT / "src" / "check" / "signature.rs").read_text(), re.DOTALL)
    types = set(re.findall(r'^ +"(\w+)" =>', body, re.MULTILINE))
    assert {"scalar", "vec3", "camera", "any"} <= types

    def is_type(word: str) -> bool:
        return (Keyword.Type, word) in list(pygments.lex(f"fn f(a: {word}) = 1", _highlight.DsceneLexer()))

    assert not {word for word in types if not is_type(word)}
    known = set(re.findall(r"[a-z_0-9]+", Path(_highlight.__file__).read_text()))
    assert {word for word in known if is_type(word)} == types


def test_cells_in_the_terminal_have_colours(optional: Callable[[str], Any]) -> None:
    ptutils = optional("IPython.terminal.ptutils")
    from dscene._highlight import color_cells

    lexer = ptutils.IPythonPTLexer()
    shell = SimpleNamespace(pt_app=SimpleNamespace(lexer=SimpleNamespace(lexer=lexer)))
    color_cells(shell)
    document = optional("prompt_toolkit.document").Document("%%dscene\nparam glow = 0.5 in 0..1")
    line = lexer.lex_document(document)(1)
    assert ("class:pygments.keyword.declaration", "param") in [fragment[:2] for fragment in line]
    # A shell without a terminal is left as it is.
    color_cells(SimpleNamespace())
