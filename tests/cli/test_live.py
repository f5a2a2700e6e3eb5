"""``bozzini live``: a phantom that breathes, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pyigtl.messages import message_type_to_class_constructor

from bozzini.anatomy import write_tract
from bozzini.cli.main import main
from tests.cockpit.conftest import wait_until
from tests.duct.test_moving import make_tube
from tests.scene.test_slicer import Model, serve

pytestmark = pytest.mark.slow  # its kernels are compiled for little else

CAPTURE = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    surface, _ = make_tube(radius=6.0, length=70.0, bend=40.0)
    path = tmp_path_factory.mktemp("tube") / "tube.ply"
    write_tract(path, surface)
    return path


def live(capsys: CAPTURE, *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(["live", *map(str, arguments), "--quiet"])
    return code, *capsys.readouterr()


SMALL = ("--diameter", "5mm", "--link", "8mm", "--duration", "0.3s", "--amplitude", "2mm")


def test_a_tube_that_breathes_is_kept_clear(capsys: CAPTURE, tube: Path, tmp_path: Path) -> None:
    table = tmp_path / "frames.csv"
    code, out, _ = live(capsys, tube, *SMALL, "--json", "--out", table)
    found = json.loads(out)
    assert code == 0
    assert found["converged"] is True
    assert found["frames"] == found["frames_held"] == 9
    rows = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert len(rows) == 9
    assert rows["clearance_mm"].min() == pytest.approx(found["clearance_min_mm"])
    assert rows["margin_mm"][0] == pytest.approx(found["speed_mm/s"] / found["rate_Hz"])


def test_a_wall_too_fast_for_the_rate_is_said_and_drawn(
    capsys: CAPTURE, tube: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "live.png"
    fast = ("--period", "0.2s", "--rate", "10Hz")
    code, out, _ = live(capsys, tube, *SMALL, *fast, "--out", picture)
    assert code == 1
    assert "until the next frame" in out
    assert picture.read_bytes()[:4] == b"\x89PNG"


class Kept(dict[str, object]):
    """All that comes of each device, where pyigtl keeps the last."""

    def __setitem__(self, name: str, message: object) -> None:
        super().__setitem__(name, [*self.get(name, []), message])


def test_slicer_shows_each_frame(capsys: CAPTURE, tube: Path, monkeypatch) -> None:
    monkeypatch.setitem(message_type_to_class_constructor, "POLYDATA", Model)
    with serve() as (server, address):
        server.incoming_messages = Kept()
        short = ("--duration", "0.1s", "--frame", "RAS", "--igtl", address)
        code, out, err = live(capsys, tube, *SMALL[:4], *SMALL[6:], *short, "--json")
        assert code == 0, err
        wait_until(lambda: len(server.incoming_messages.get("ScopeTip", [])) == 3)
    shown = server.incoming_messages
    assert json.loads(out)["frames"] == len(shown["Wall"]) == len(shown["Scope"]) == 3
    first, _, last = (wall.points for wall in shown["Wall"])
    assert 1e-3 < np.linalg.norm(last - first, axis=1).max() < 2.0
    tips = [tip.matrix[:3, 3] for tip in shown["ScopeTip"]]
    line = shown["Line"][0].points
    assert np.linalg.norm(line - tips[0], axis=1).min() < 3.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--rate", "0Hz"), "rate is 0 Hz: it must lie in"),
        (("--motion", "walking"), "it must be breathing, peristalsis or an .npz file"),
        (("--motion", "none.npz"), "no such file: none.npz"),
        (("--motion", "breathing", "--depth", "0.5"), "--motion breathing has none"),
    ],
)
def test_what_is_wrong_is_one_line(
    capsys: CAPTURE, tube: Path, options: tuple[str, ...], message: str
) -> None:
    code, out, err = live(capsys, tube, "--diameter", "5mm", "--link", "8mm", *options)
    assert (code, out) == (2, "")
    assert message in err
    assert len(err.splitlines()) == 1
