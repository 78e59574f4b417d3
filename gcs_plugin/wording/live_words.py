"""Words of the live screens: 3D scene, page, terminal and log.

They name figures that are unknown and what would help, silent vehicles, the link and the recording.
The page's own words are in `page_words.toml`, their translations in the `.po` files.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

from thrustmargin.gcs_plugin.wording.alarm_words import ONE_LOST, ONE_MORE_LOST, SPINS
from thrustmargin.gcs_plugin.wording.check_words import airframe_match_words, source_words
from thrustmargin.gcs_plugin.wording.language import (
    Verbatim,
    percent,
    say,
    translations,
)
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind

PREDICTED = "predicted"
NOTHING_KNOWN = "no rotor speed and no prediction"
SCREEN_REFUSES = "only the page of this view may do that"
ALARMS_SOUGHT = "alarms still being looked for"
ALARMS_UNKNOWN = "alarms are not known: this flight could not be searched for them"
#: Names of colours and cameras, which the catalogue has in other languages.
THRUST_LEFT = "Thrust left"
TANK_SHOWN = "Tank"
PLANNED = "forecast from the plan"
WHOLE_FIELD, NORTH_UP, NOSE_FORWARD = "Whole field", "Follow, north up", "Follow, nose ahead"
RESIDUAL_BEFORE, RESIDUAL_AFTER = "Residual before", "Residual after"
ALL_PREDICTED = "predicted: no rotor speed was measured"
HOME = "Home"


@cache
def page_words(language: str) -> dict[str, dict[str, str]]:
    """Return the texts of the live page in `language`: dicts "words", by key, and "names".

    "names" translates labels that the server sends to the page, by the English label. Texts keep
    their {placeholders}. Raises FileNotFoundError for a language that is not in LANGUAGES.
    """
    file = resources.files(__package__ or "") / "page_words.toml"
    parts: dict[str, dict[str, str]] = tomllib.loads(file.read_text("utf-8"))
    table = translations(language, "page")
    return {
        part: {key: table.get(english, english) for key, english in words.items()}
        for part, words in parts.items()
    }


def short_match_words(airframe_match: AirframeMatch) -> str:
    """Return which airframe a vehicle is analysed with, and how it was chosen.

    The checks by which it was recognised are left out.
    """
    if airframe_match.basis == "recognised":
        name = Verbatim(airframe_match.airframe)
        return say("airframe {name}: nobody named it, and the flight fits it", name=name)
    return airframe_match_words(airframe_match)


def wind_words(speed: float) -> str:
    """Return the wind speed, m/s, in words."""
    return f"wind {speed:.1f} m/s"


def margin_ahead(share: float) -> str:
    """Return the sentence on the thrust left (`share`) on the rest of the route in steady
    flight."""
    return f"rest of the route: thrust left {left_words(share)}, less for moments in turns"


def model_with(effects: Sequence[str]) -> str:
    """Return the words that list the effects in the model."""
    if not effects:
        return say("model without effects")
    return say("model with {effects}", effects=", ".join(effects))


def measured_share(basis: str, share: float) -> str:
    """Return `BASIS for 80 %, predicted for the rest`; `basis` names the source of the rotor
    speeds, `share` is the part of the time that has them."""
    return say(
        "{basis} for {share}, predicted for the rest", basis=say(basis), share=percent(share)
    )


def drawn_larger(scale: float) -> str:
    """Return the words for the scale at which the aircraft is drawn."""
    return f"aircraft drawn {scale:.0f} x its size" if scale > 1.0 else "true size"


def grid_words(cell: float) -> str:
    """Return the size of a cell of the ground grid, m, in words."""
    return f"grid {cell:g} m"


@dataclass(frozen=True, slots=True)
class WhyUnknown:
    """The reason why a figure is unknown, and the option that requests it from the vehicle, if
    any."""

    words: str
    option: str = ""

    def text(self, asked: Collection[str] = ()) -> str:
        """Return why a figure is unknown, and the option that requests the missing messages.

        If `asked` contains that option, it is in use already, and the text says that it has not
        helped.
        """
        words = say(self.words)
        if not self.option:
            return words
        if self.option in asked:
            return say("{words}; asked for in vain so far", words=words)
        return say("{words}; {option} asks for it", words=words, option=self.option)


#: Options that request messages from a vehicle.
RATES, FETCH = "--request-rates", "--fetch-mission"
#: Why a figure is unknown.
NO_SPEEDS = WhyUnknown("no rotor speeds (ESC telemetry) and no motor outputs heard", RATES)
NO_MEASURED = WhyUnknown("no rotor speeds measured (ESC telemetry)", RATES)
NO_LOAD = WhyUnknown(
    "tank level unknown: no gauge, and no hover yet that shows the load (10 s, with rotor speeds "
    "or motor outputs); --load states it, --tank names its source"
)
BAD_PART = WhyUnknown(ONE_MORE_LOST)
NO_AIRSPEED = WhyUnknown("no airspeed and no ground speed heard", RATES)
NEXT_SORTIE = "armed again after a flight: the load that you state is taken for this sortie anew"
NO_MISSION = WhyUnknown("no mission heard", FETCH)
NO_FLOW = WhyUnknown("no pump output heard, and no gauge that shows the flow (20 s)")
NO_POSITION = WhyUnknown("no position heard")
NO_ROWS = WhyUnknown(
    "heard, but neither rotor speeds, motor outputs, attitude nor position with its clock", RATES
)

#: Figures that can be unknown, by the name printed with the reason.
MEASURED_MARGIN, PREDICTED_MARGIN = "measured thrust left", "predicted thrust left"
TANK, TANK_BY_THRUST, TIME_TO_EMPTY = "tank", "tank by thrust", "time to empty"
REMAINING_ROUTE, FULL_MARGIN = "route ahead", "thrust left with a full tank"
#: Reported field -> its name in a line about old values.
FIELD_WORDS: Mapping[str, str] = {
    "attitude": "attitude",
    "position_ned": "position",
    "velocity_ned": "speed over ground",
    "height_agl": "height",
    "airspeed": "airspeed",
    "wind_ned": "wind",
    "voltage": "battery voltage",
    "pressure": "air pressure",
    "throttle": "motor outputs",
    "tank_kg": "tank level",
}

NO_VEHICLE = "no vehicle heard yet"
NO_ALARM = "no alarm"
NO_SAMPLES = (
    "messages and events are recorded, and no table of samples, which needs pyarrow; "
    "to have it run: {line}"
)
HEARD, WATCHED_AGAIN, RECORDING_AGAIN = "heard", "watched again", "recording again"
NOT_BEHIND = "no longer behind"
CUT_OFF = "ended before all that came was analysed: the answer is without the rest"
ON_GROUND, NO_VERDICT, OLD = "on ground", "NO VERDICT", "OLD"
#: Columns of the terminal's table, and the line below it.
BY_THRUST, EMPTY_IN, IF_FULL = "by thrust", "empty in", "if full"
BEYOND = "<0%"  # of a margin, in a column's width
LEGEND = (
    f"thrust left: worst rotor, ± where not measured, ≈ predicted · {ONE_LOST}: thrust that can be "
    f"held over weight, {SPINS} · route ahead: what lasts, less for moments in turns · "
    f"{BEYOND}: beyond the ceiling · ~ old, the last that was known"
)
#: Beginnings of status lines that are highlighted.
NOT_RECORDING, BEHIND = "NOT RECORDING", "this computer is"
STOPPED = "STOPPED BY AN ERROR"
#: Counter of lost frames in the status -> its words.
LOST: Mapping[str, str] = {
    "bad_checksum": "with a wrong checksum",
    "bytes_skipped": "bytes skipped",
    "refused": "refused by signing",
    "kernel_drops": "dropped by the system",
    "compute_drops": "not analysed: this computer is too slow",
}


def behind_words(behind_s: float, *, page: bool = False) -> str:
    """Return the line about a computer that is too slow, `behind_s` late, and the remedy."""
    words = "this computer is {seconds} s behind: closing other programs helps"
    if page:
        words = "this computer is {seconds} s behind: closing the 3D page helps"
    return say(words, seconds=f"{behind_s:.0f}")


def not_read_again(error: BaseException) -> str:
    """Return the line about a landed flight that could not be read as a whole, with the error."""
    why = f"{type(error).__name__}: {error}"
    return f"the last flight cannot be read as a whole: its answer is that of the flight ({why})"


def output_failed(name: str, error: BaseException) -> str:
    """Return the line about an output of the monitor that an error of this program has ended."""
    why = f"{type(error).__name__}: {error}"
    return f"{STOPPED}: {name} ({why}); all else goes on; start the monitor again to have it back"


def of_vehicle(number: int, words: str) -> str:
    """Return `words` with the vehicle's number in front."""
    return say("vehicle {number}: {words}", number=number, words=Verbatim(words))


def not_heard_on(urls: Iterable[str]) -> str:
    """Return the line about addresses on which no vehicle was heard."""
    return f"{NO_VEHICLE} on {', '.join(urls)}"


def last_heard(number: int, unix_s: float) -> str:
    """Return the line on when a vehicle was last heard, by this computer's local time."""
    at = time.strftime("%H:%M", time.localtime(unix_s))
    return f"vehicle {number} was last heard at {at}"


def two_vehicles(system: int) -> str:
    """Return the line about two vehicles with the same system id, and the remedy."""
    return say(
        "two vehicles send as system {system}: nothing is computed; give each its own id "
        "(SYSID_THISMAV or MAV_SYSID)",
        system=system,
    )


def silent_words(number: int, gone_s: float) -> str:
    """Return the line about a vehicle that has been silent for `gone_s`."""
    return f"vehicle {number} silent for {gone_s:.0f} s"


def heard_words(number: int, *, again: bool = False) -> str:
    """Return the line about a vehicle that is heard, for the first time or again."""
    return f"vehicle {number} heard{' again' if again else ''}"


def unknown_words(figures: Iterable[str], reason: str) -> str:
    """Return the line about unknown figures with one reason."""
    return say("unknown: {figures}: {reason}", figures=", ".join(map(say, figures)), reason=reason)


def stale_words(ages: Mapping[str, float]) -> str:
    """Return the line about fields that are no longer reported, oldest first, with ages in s; empty
    if none."""
    if not ages:
        return ""
    oldest_first = sorted(ages.items(), key=lambda a: -a[1])
    parts = [f"{say(words)} ({age:.0f} s)" for words, age in oldest_first]
    return say("no longer reported: {fields}", fields=", ".join(parts))


def not_followed_words(rates: Mapping[str, tuple[float, float]]) -> str:
    """Return the line on messages that come more slowly than requested; empty if `rates` is.

    `rates` maps the name of each such message to (received, requested), Hz. All of them are listed:
    rates are not compared here.
    """
    if not rates:
        return ""
    parts = (f"{name} {came:.1f} of {asked:g} Hz" for name, (came, asked) in rates.items())
    return f"does not send as asked: {', '.join(parts)}; asked again, ever more rarely"


def no_escs(source: Provenance) -> str:
    """Return the line about rotor speeds from `source` without ESC telemetry."""
    speeds = Verbatim(source_words(source))
    return say("no ESC telemetry: rotor speeds {speeds}", speeds=speeds)


def tank_by(source: Provenance) -> str:
    """Return the words for the source of the tank level."""
    return say("tank {source}", source=Verbatim(by_source(source)))


def by_source(source: Provenance) -> str:
    """Return a source in words, `by NAMED_VALUE_FLOAT TANK` or `stated: 8 kg`; empty if absent."""
    if source.kind is SourceKind.ABSENT:
        return ""
    reported = source.kind is not SourceKind.STATED and source.meaning is not Meaning.HOVER_THRUST
    words = source_words(source)
    return say("by {source}", source=Verbatim(words)) if reported else words


def messages_words(frames: int, lost: Mapping[str, int], refused_why: str = "") -> str:
    """Return the line with the number of frames received, and in brackets those lost by each cause.

    `lost` maps a cause, a key of LOST, to its number; causes with none are left out. `refused_why`
    is why frames were refused, empty if none was.
    """
    parts = [f"{lost[name]} {say(words)}" for name, words in LOST.items() if lost.get(name)]
    line = say("{count} messages", count=frames) + (f" ({', '.join(parts)})" if parts else "")
    return line + (say("; refused: {why}", why=refused_why) if refused_why else "")


def recording_words(folder: str, frames: int, rows: int, lost: int) -> str:
    """Return the line about a recording: folder, messages, samples, and messages lost earlier."""
    earlier = say(", {lost} lost earlier", lost=lost) if lost else ""
    words = "recording to {folder}: {frames} messages, {rows} samples"
    return say(words, folder=Verbatim(folder), frames=frames, rows=rows) + earlier


def not_recording(trouble: str, lost: int | None = None) -> str:
    """Return the line about a recording that has stopped; with `lost` messages, also the remedy."""
    line = f"{say(NOT_RECORDING)}: {trouble}"
    if lost is None:
        return line
    return line + say(" ({lost} messages lost); make room, it goes on by itself", lost=lost)


def tried_words(tried: Mapping[str, str]) -> str:
    """Return the line about addresses tried without a vehicle, grouped by the reason of each."""
    by_why: dict[str, list[str]] = {}
    for url, why in tried.items():
        by_why.setdefault(why, []).append(url)
    parts = [f"{', '.join(urls)}: {why}" for why, urls in by_why.items()]
    return "no vehicle heard; give the address where it is sent. Tried " + "; ".join(parts)
