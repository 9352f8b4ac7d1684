"""Colours for scripts: a lexer for Pygments, by which IPython's terminal, Sphinx and nbconvert show them."""

from __future__ import annotations

from typing import Any

from pygments.lexer import RegexLexer, bygroups, words
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Text

__all__ = ["DsceneLexer", "color_cells"]

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
# Words that declare something if a name follows, and are names otherwise: `camera eye { … }`, `eye.camera`.
_DECLARE = "let|param|loss|stage|fn|camera|material|texture|mesh|shape|light|medium|scene|integrator"
_CONTROL = "import as native optimize every save print plot expect sweep report with in to for if then else let param fn stage".split()
_TYPES = (
    "scalar int bool string angle vec2 vec3 vec4 color mat3 mat4 rotation transform image texture mesh material shape light medium camera "
    "scene integrator optimizer preconditioner distribution network samples number angles any"
).split()


class DsceneLexer(RegexLexer):
    """Scripts of dscene."""

    name = "dscene"
    aliases = ["dscene"]
    filenames = ["*.dscene"]
    mimetypes = ["text/x-dscene"]
    url = ""
    version_added = ""

    tokens = {
        "root": [
            (r"\s+", Text),
            (r"///(?!/).*$", String.Doc),
            (r"//.*$", Comment.Single),
            (r"/\*", Comment.Multiline, "comment"),
            (r'"', String.Double, "string"),
            (r"#[0-9A-Za-z]+", Number.Hex),
            (r"([0-9][0-9_]*(?:\.[0-9][0-9_]*)?(?:[eE][+-]?[0-9]+)?)([A-Za-z_]+|%)?", bygroups(Number, Keyword.Type)),
            (rf"(\.)({_NAME})", bygroups(Operator, Name.Attribute)),
            (rf"({_NAME})(\s*)(?=:)", bygroups(Name.Attribute, Text)),
            (rf"\b({_DECLARE})(\s+)(?!(?:in|to|over|with|then|else|for|if|and|or|within|of)\b)({_NAME})", bygroups(Keyword.Declaration, Text, Name.Variable)),
            (r'\btest\b(?=\s*")', Keyword.Declaration),
            (r"\b(within|of)\b(?!\s*[=,)])", Operator.Word),
            (r"\bover\b(?=\s+[A-Za-z0-9_(\[{])", Keyword),
            (words(("true", "false", "none"), prefix=r"\b", suffix=r"\b"), Keyword.Constant),
            (words(("and", "or", "not"), prefix=r"\b", suffix=r"\b"), Operator.Word),
            (words(_CONTROL, prefix=r"\b", suffix=r"\b"), Keyword),
            (rf"{_NAME}(?=\s*\()", Name.Function),
            (words(_TYPES, prefix=r"(?<=[:|] )", suffix=r"\b"), Keyword.Type),
            (_NAME, Name),
            (r"\|>|=>|\.\.=?|[=!<>]=|[-+*/@^<>=~|≈.]", Operator),
            (r"[][(){},:;]", Punctuation),
        ],
        "comment": [
            (r"/\*", Comment.Multiline, "#push"),
            (r"\*/", Comment.Multiline, "#pop"),
            (r"[^*/]+|[*/]", Comment.Multiline),
        ],
        "string": [
            (r'"', String.Double, "#pop"),
            (r"\\(?:u\{[0-9a-fA-F]*\}|.)|\{\{|\}\}", String.Escape),
            (r"\{[^}\"\n]*\}", String.Interpol),
            (r'[^"\\{}\n]+|[{}]', String.Double),
            (r"\n", Text, "#pop"),
        ],
    }


def color_cells(shell: Any) -> None:
    """Shows ``%%dscene`` cells in colours as they are typed, where the shell is IPython's terminal. Others have editors of their own."""
    terminal = getattr(shell, "pt_app", None)
    lexers = getattr(getattr(getattr(terminal, "lexer", None), "lexer", None), "magic_lexers", None)
    if isinstance(lexers, dict):
        from prompt_toolkit.lexers import PygmentsLexer

        lexers["dscene"] = PygmentsLexer(DsceneLexer)
