"""A hangar with one known aircraft, for tests of commands that recognise or teach it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from thrustmargin.gcs_plugin.logs.read import read_log
from thrustmargin.gcs_plugin.store.aircraft_marks import marks_of
from thrustmargin.gcs_plugin.store.hangar import Hangar

BOARD_LOG = Path("sitl_logs/formats/v4_m10_q2.5.BIN")  # with the calibration of its sensors


def hangar_with_north(folder: Path) -> Hangar:
    """Return a new hangar with the simulated F16 as `north`, as its shipped model predicts it."""
    made = Hangar(folder)
    kept = made.aircraft_folder("north")
    kept.mkdir(parents=True)
    for name, place, file in (
        ("model.safetensors", "shipped", "default.safetensors"),
        ("airframe.toml", "airframes", "topxgun-f16-sitl.toml"),
    ):
        content = resources.files(f"thrustmargin.models.{place}").joinpath(file).read_bytes()
        (kept / name).write_bytes(content)
    made.keep("north", [marks_of(read_log(BOARD_LOG))], made_unix_s=0.0, training=[])
    return made
