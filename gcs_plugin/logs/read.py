"""`read_log`: any log as one flight, by what the file holds and not by its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from thrustmargin.gcs_plugin.logs import ulog
from thrustmargin.gcs_plugin.logs.csv_table import decoded, names_time, read_csv
from thrustmargin.gcs_plugin.logs.dataflash.binary import read_dataflash
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import dataflash_signals
from thrustmargin.gcs_plugin.logs.dataflash.text_log import read_dataflash_text
from thrustmargin.gcs_plugin.logs.tlog import read_tlog
from thrustmargin.gcs_plugin.telemetry.flight_log import assemble, log_of_track
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog, NotThisFormat
from thrustmargin.gcs_plugin.telemetry.resample import Sampling, plausible
from thrustmargin.gcs_plugin.telemetry.signals import airspeed_words, mavlink_signals, pitot_present
from thrustmargin.gcs_plugin.telemetry.statements import Options, stated_track
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.flight import TRACK_CHANNELS
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.whole_file import regular

_FMT_HEAD = b"\xa3\x95\x80"
_LOOK = 1 << 20  # bytes in which the format shows
#: format -> the suffixes that fit it
_SUFFIXES = {
    "tlog": (".tlog",),
    "DataFlash": (".bin", ".log"),
    "DataFlash text": (".log", ".txt"),
    "ULog": (".ulg", ".ulog"),
    "CSV": (".csv",),
}


def read_log(
    path: str | Path,
    *,
    vehicle: int | None = None,
    airframe: Airframe | None = None,
    sampling: Sampling = "linear",
    tank: str = "auto",
    tank_start_kg: float | None = None,
    load: float | None = None,
    load_end: float | None = None,
    air_temperature: float | None = None,
    any_vehicle: bool = False,
) -> FlightLog:
    """Read one vehicle's flight from a .tlog, DataFlash .BIN or .log, PX4 .ulg or .csv file.

    `vehicle` is the system id (default: the one that reports rotor speeds); `airframe` gives
    the number of rotors, the tank and the liquid; `sampling` puts other channels onto the rows by
    interpolation ("linear") or as a live listener would ("hold"); `tank` names the source of the
    tank level as `telemetry.tank_source` lists them; `tank_start_kg` is what a tank without a
    gauge held at the start of the log. `load` and `load_end`, kg on board at the start and at the
    end, take the place of any gauge, `air_temperature` in K that of the autopilot's own reading
    (see `telemetry.statements`). `any_vehicle` reads one that is no multirotor, too. Raises
    LogError when the file holds no flight or is of another vehicle, AirframeError when the
    airframe has another number of rotors.

        >>> log = read_log("sitl_logs/campaign/v4_m16_q2.5.tlog")
        >>> log.track.rotor_speed_rpm.shape
        (2210, 4)
    """
    path = Path(path)
    options = Options(
        airframe=airframe,
        sampling=sampling,
        tank=tank,
        tank_start_kg=tank_start_kg,
        load=load,
        load_end=load_end,
        air_temperature=air_temperature,
    )
    try:
        kind, log = _read_as(path, formats(path), vehicle, options)
    except FileNotFoundError as error:
        raise LogError(f"no file {path}; check the name") from error
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}") from error
    refusal = log.facts.refusal(path.name)
    if refusal and not any_vehicle:
        raise LogError(refusal)
    if path.suffix.lower() not in _SUFFIXES[kind]:
        note = f"{path.name} is a {kind} file by its content, whatever its name says"
        log = replace(log, track=replace(log.track, notes=(*log.track.notes, note)))
    return log


def _read_as(
    path: Path, kinds: tuple[str, ...], vehicle: int | None, options: Options
) -> tuple[str, FlightLog]:
    """The log read as the first of `kinds` that it can be read as, and that kind."""
    for kind in kinds:
        try:
            return kind, _read(path, kind, vehicle, options)
        except NotThisFormat:
            continue
    raise LogError(
        f"{path.name}: no message in {path.stat().st_size} bytes, neither MAVLink frames (.tlog) "
        "nor an ArduPilot log (.BIN, it begins with descriptions FMT) nor a PX4 log (.ulg, it "
        "begins with ULog); is its start missing?"
    )


def _read(path: Path, kind: str, vehicle: int | None, options: Options) -> FlightLog:
    if kind == "CSV":
        craft = options.airframe
        track = read_csv(path, rotor_count=0 if craft is None else craft.rotor_count)
        _check_rotors(path, track.rotor_count, options.airframe)
        known = {name: plausible(name, getattr(track, name)) for name in TRACK_CHANNELS}
        track = stated_track(replace(track, **known), options)
        return log_of_track(track, path, path.stat().st_size, options.airframe)
    if kind == "ULog":
        recording, signals = ulog.read_ulog(path, vehicle=vehicle)
        return assemble(recording, signals, options)
    if kind == "tlog":
        live = options.sampling == "hold"
        recording = read_tlog(path, vehicle=vehicle, on_arrival=live)
        pitot = pitot_present(recording.streams, recording.parameters)
        words = airspeed_words(recording.autopilot, pitot)
        streams = dict(recording.streams)
        recording = replace(recording, streams={})
        return assemble(recording, mavlink_signals(streams, words), options)
    reader = read_dataflash if kind == "DataFlash" else read_dataflash_text
    recording = reader(path, vehicle=vehicle)
    return assemble(recording, dataflash_signals(recording.streams), options)


def formats(path: Path) -> tuple[str, ...]:
    """Formats to try, by the first bytes. Raises LogError for a folder, nothing, other text."""
    if path.is_dir():
        raise LogError(f"{path} is a folder; give a log file in it")
    with regular(path).open("rb") as file:
        head = file.read(_LOOK)
    if not head:
        raise LogError(f"{path.name} is empty (0 bytes); copy it from the vehicle again")
    if head.startswith(ulog.MAGIC):
        return ("ULog",)
    if _is_text(decoded(head[:4096])):
        if b"FMT," in head:
            return ("DataFlash text",)
        if path.suffix.lower() == ".csv" or names_time(decoded(head)):
            return ("CSV",)
        raise LogError(
            f"{path.name} is text, but neither a DataFlash log (FMT lines) nor a CSV with time_s"
        )
    if head.count(_FMT_HEAD) >= 3 or path.suffix.lower() in (".bin", ".log"):
        return ("DataFlash", "tlog")
    return ("tlog", "DataFlash")


def _is_text(text: str) -> bool:
    control = any(character < " " and character not in "\t\n" for character in text)
    return not control and text.count("\ufffd") <= 1 + len(text) // 100


def _check_rotors(path: Path, rotors: int, airframe: Airframe | None) -> None:
    if airframe is not None and rotors != airframe.rotor_count:
        raise AirframeError(
            f"{path.name}: columns of {rotors} rotors, but airframe {airframe.name} has "
            f"{airframe.rotor_count}; choose another with --airframe"
        )
