"""What notebooks show."""

from __future__ import annotations

import struct
import zlib

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


def test_cells_are_scripts(capsys: pytest.CaptureFixture[str]) -> None:
    interactive = pytest.importorskip("IPython.core.interactiveshell")
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
