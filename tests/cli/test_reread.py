"""What commands read again for a plan is told like what ``plan`` reads."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import nibabel
import numpy as np
import pytest

import bozzini.motion.verify as verify
from bozzini.cli.common import Answer
from bozzini.cli.routing import reread_tract


def test_warnings_of_a_volume_read_again_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = np.zeros((6, 6, 12), dtype=np.uint8)
    labels[2:4, 2:4, 2:10] = 1
    image = nibabel.Nifti1Image(labels, np.diag([1.5, 1.5, 1.5, 1.0]))
    image.header.set_xyzt_units("mm")
    image.set_sform(np.diag([-1.5, 1.5, 1.5, 1.0]), code=1)
    image.set_qform(np.diag([1.5, 1.5, 1.5, 1.0]), code=1)
    nibabel.save(image, tmp_path / "tube.nii")
    monkeypatch.setattr(verify, "is_made_from", lambda *_: True)
    monkeypatch.setattr(verify, "rebuild_field", lambda *_, progress: None)
    reread_tract(SimpleNamespace(input=None), tmp_path / "tube.nii", Answer(as_json=False))  # type: ignore[arg-type]
    assert "left and right are swapped" in capsys.readouterr().err
