"""Options that commands take together, and the quantities in them."""

import inspect
from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from armcontour._quantities import Angle, Length, Speed, Tolerance
from armcontour.cli.options import grouped
from armcontour.cli.quantities import read_option, read_option_list
from armcontour.errors import InvalidInput


@dataclass(frozen=True, kw_only=True)
class Size:
    wide: Annotated[float, typer.Option("--wide", help="Width.")] = 1.0
    layer: Annotated[list[str] | None, typer.Option("--layer", help="Layers.")] = None


def test_the_fields_of_a_group_are_options_of_its_command():
    app = typer.Typer()

    @app.command()
    @grouped
    def draw(
        name: Annotated[str, typer.Argument(help="Name.")],
        size: Size,
        deep: Annotated[bool, typer.Option("--deep", help="Depth.")] = False,
    ) -> None:
        typer.echo(f"{name} {size.wide:g} {size.layer} {deep}")

    assert list(inspect.signature(draw).parameters) == ["name", "wide", "layer", "deep"]
    for line, said in (
        ("a", "a 1 None False"),
        ("a --layer x --wide 2 --layer y --deep", "a 2 ['x', 'y'] True"),
    ):
        assert CliRunner().invoke(app, line.split()).output.strip() == said


def test_a_quantity_has_a_unit_unless_it_is_zero():
    assert read_option("--speed", None, Speed) is None
    assert read_option_list("--turn", "0, -0.0, 0e3", Angle) == (0.0, 0.0, 0.0)
    assert read_option("--speed", " 50 mm/s ", Speed) == 0.05
    assert read_option_list("--speeds", "0.1 m/s, 0.2m/s,50 mm/s", Speed) == (0.1, 0.2, 0.05)
    assert read_option_list("--speeds", None, Speed) is None
    assert read_option_list("--at", "1 m, 2 m", Length, counts=(2, 3)) == (1.0, 2.0)
    (turn,) = read_option_list("--turn", "90 deg", Angle) or ()
    assert turn == pytest.approx(1.5707963267948966, rel=1e-15)


def test_other_texts_are_refused_with_the_option():
    for text, words in (
        ("5 mm", "^--speed: must be a quantity in m/s, which '5 mm' is not.$"),
        ("0", "^--speed: must be above zero, but is 0 m/s.$"),
        ("1e300 m/s", "^--speed: must be between -1e\\+12 and 1e\\+12 m/s"),
        ("5", "^--speed: '5' has no unit: write one, as in '0.15 m/s'.$"),
        ("fast", "^--speed: 'fast' is not a quantity in m/s"),
        ("", "^--speed: '' is not a quantity in m/s"),
    ):
        with pytest.raises(InvalidInput, match=words):
            read_option("--speed", text, Speed)
        with pytest.raises(InvalidInput, match=words):
            read_option_list("--speed", f"0.1 m/s, {text}", Speed)
    # The unit is that of the text.
    with pytest.raises(InvalidInput, match="^--servo: must be above zero, but is -0.5 mm.$"):
        read_option("--servo", " -0.5 mm ", Tolerance)
    with pytest.raises(InvalidInput, match="--at takes 2 or 3 values"):
        read_option_list("--at", "1 m", Length, counts=(2, 3), example="1 m, 2 m")
