"""List the sentences of what readers note and of where a number is from, one for each kind.

`check_words` makes them, as it does those of the checks. `{source}` in a remark is the source that
the number was made from, or else the one that was rejected for it.
"""

from __future__ import annotations

from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.flight_words import GROUNDED_BY

#: Kind of a remark on the source of a number -> its words.
REMARKS: Mapping[str, str] = {
    "as written": "{text}",
    # Load
    "but thrust shows": "but hover thrust shows {load:.1f} ± {within:.1f} kg (90 %)",
    "load within": "± {within:.1f} kg, 90 %",
    "so far": "so far",
    "constant": "constant",
    "falling with pump": "falling with the pump's output",
    "falling by trend": "falling by its own trend",
    "covers little": "{source} covers {percent:.0f}% of the flight",
    "stated load too little": (
        "{load:.1f} kg as stated are too little for these rotor speeds: check gauge and empty "
        "mass, and with the battery off the propellers"
    ),
    "gauge too little": (
        "{load:.1f} kg by {source} are too little for these rotor speeds: check gauge and empty "
        "mass, and with the battery off the propellers"
    ),
    "load falls to": "{load:g} kg at the start, falling with {cause} to {end:g} kg",
    "load falls": "{load:g} kg at the start, falling with the pump's output",
    "at least": ", at least {end:g} kg",
    "load constant": "{load:g} kg, constant: nothing shows that it falls",
    "without a tank": "without a tank: 0 kg",
    "from the plan": "from the plan",
    # Rotor speeds by motor outputs
    "outputs by curve": "{outputs}, {curve}",
    "exponent set": "MOT_THST_EXPO {expo:g}",
    "exponent assumed": "an assumed exponent of {expo:g}",
    "thrust factor": "THR_MDL_FAC {factor:g}",
    "thrust exponent assumed": "an assumed thrust exponent of {expo:g}",
    "curve of speeds": "{source}",
    "set by measured rotors": "set by the rotors whose speed is measured",
    "set by weight": "set by the weight over {seconds:.0f} s of level flight",
    "by full thrust": "by the airframe's full thrust, for the weight is not known",
    "inferred rotor": "rotor {rotors}",
    "inferred rotors": "rotors {rotors}",
    "all rotors inferred": "all rotors from {start_clock} to {end_clock}",
    # Motors, outputs and ESCs
    "no lifting motors": "no motors that lift",
    "motors by SERVOn": "motors on outputs {outputs} by SERVOn_FUNCTION",
    "motors by PWM_FUNCn": "motors on outputs {outputs} by PWM_{bank}_FUNCn",
    "motors taken as outputs": "motor n taken to be on output n: {outputs}",
    "ESCs taken as motors": "ESC n taken to be that of motor n: {escs}",
    "turned ESCs taken": ("; ESCs {escs} turned and are taken for theirs, in order of the outputs"),
    "other ESCs turned": (", but other ESCs turned: which is whose is not known, and none is used"),
    "by actuator functions": "by PX4's actuator functions",
    "by PWM_FUNCn": "by PWM_{bank}_FUNCn",
    "motor n on output n": "motor n taken to be on output n",
    "motor n has ESC n": "motor n taken to have ESC n",
    "Betaflight's order": "in Betaflight's order by MOT_ORDERING",
    "pulse ranges": "{ranges:and}",
    "pulse range": "{low:g} to {high:g} {unit}, {set_by}",
    "port": "port {number:g}",
    "order assumed": "{order}",
    "in vain": "; asked for in vain so far",
    "rates ask": "; --request-rates asks for it",
    # Battery, tank and pump
    "sum of ESCs": "sum of ESCs",
    "mean of ESCs": "mean of ESCs",
    "litres": "litres",
    "ml": "ml",
    "of airframe's tank": "of the airframe's tank",
    "tank by ml used": "a tank: ml used of {whose}",
    "tank by percent": "a tank: % of {whose}",
    "capacity set": "{name} {ml:g} ml",
    "airframe's capacity": "the airframe's {litres:g} L",
    "summed": "servo {servo}, summed from the stated {start:g} kg",
    "full flow": "{flow:g} L/min at full output",
    "pump": "pump",
    "above its minimum": "above its minimum",
    "tank level falls": "tank level falling by more than {rate:.2f} kg/min",
    # Air
    "less wind": "less {wind}'s wind",
    "velocity less wind": "velocity less wind",
    "pitot": "pitot",
    "calibrated airspeed": "calibrated airspeed, as PX4 sends it",
    "pitot or estimate": "pitot or estimate: the vehicle does not say",
    "estimate without pitot": "EKF estimate, else GPS speed: a copter without pitot",
    "NED vector": "NED vector",
    "direction turned round": "direction it comes from, turned round",
    "EKF": "EKF",
    "level": "level",
    "outside": "{celsius:g} °C outside",
    # Place and motion
    "GPS": "GPS",
    "in mG": "in mG, as ArduPilot sends them",
    "from own origin": "from the autopilot's own origin",
    "from home": "from home",
    "from estimator's origin": "from the estimator's origin",
    "from first fix": "from the first fix, for no home is reported",
    "by source": "by {name}",
    "above ground": "above ground",
    "above estimator's origin": "height above the estimator's origin, not above the crop",
    "downward rangefinder": "rangefinder, looking down",
    "good rangefinder": "rangefinder, looking down, good readings",
    "slew limited": "smoothed by the autopilot's slew limit",
    "own frequency": "at the rotor's own frequency",
    # Off the ground
    "landed state": "{source}",
    "landed state and height": "{source}, and {clear:g} m clear of it",
    "landed events": "28 not landed, 18 landed",
    "thrust in cruise": "{by} above {share:g} of the thrust in cruise (no landed state)",
    "above home": "more than 1 m above home (no landed state, no rotor speeds)",
    "speeds else armed": "rotor speeds, else armed",
    "hover motors driven": "hover motors driven",
    **{f"grounded: {by.value}": words for by, words in GROUNDED_BY.items()},
}
#: Kind of a note of a reader -> its sentence.
NOTES: Mapping[str, str] = {
    # What a vehicle is, and by what
    "boot text": "boot text '{text}'",
    "status text": "text '{text}'",
    "own parameter": "its parameter {name}",
    "both": "{first} and {second}",
    "motors among SERVOn": "{first} and motors among SERVOn_FUNCTION",
    "counted by": "{count:.0f} by {evidence}",
    "ESCs that report": "the ESCs that report",
    "own motor outputs": "its motor outputs",
    "own columns": "its columns",
    "hover motors of a quadplane": (
        "a quadplane by {evidence}: only its hover motors are shown, and forward flight on its "
        "wings is not hover"
    ),
    "number of rotors not reported": (
        "nothing in the log reports the number of rotors: give the airframe"
    ),
    "motors of another layout": ("{count:.0f} motors by {evidence}, but {layout} has {own:.0f}"),
    "motors moved": (
        "motor {motors} not on the output of that number by SERVOn_FUNCTION: no motor output is "
        "used"
    ),
    # Rotor speeds
    "no ESC telemetry": "no ESC telemetry of its motors in the log: rotor speeds are unknown",
    "no ESC telemetry that measures": (
        "no ESC telemetry that measures in the log: rotor speeds are unknown"
    ),
    "motors without speed": "no rotor speed of motor {motors}",
    "every rotor": "every rotor: ",
    "one rotor": "rotor {rotor}: ",
    "readings counted": "{count:.0f} readings in flight, ",
    "no measurement": "no measurement: {why}",
    "no reading": "no reading for {percent:.0f} % of the flight",
    "ESC repeated": "esc_status {place} repeats motor {motor} and is left out",
    "ESCs stated": "esc_status says {stated:.0f} ESCs; {seen:.0f} of them are motors that report",
    "output beyond full": (
        "actuator_motors asks motor {motor} for {low:.2f} to {high:.2f} of full output; what is "
        "beyond 0 to 1 is taken as none or full"
    ),
    # Battery, tank and pump
    "further batteries": (
        "battery {others} reads a flight battery's voltage too; only battery {flown} is used"
    ),
    "battery number": "{number}",
    "battery range": "{number} ({low:.1f} to {high:.1f} V)",
    "no pump output": "no pump output known: spraying is read from the falling tank level",
    "tank level left out": "tank level left out, as asked",
    "tank level unknown": "no tank gauge and no pump output reported: tank level unknown",
    "liquid taken as water": "liquid taken as water, 1.0 kg/L: no airframe given",
    "only a share": "{source} is only a share: give an airframe",
    "tank of unknown volume": (
        "{name} of id {number} looks like a tank, but its volume is unknown: give an airframe"
    ),
    "start level unknown": (
        "no tank gauge: the pump's output could give the level, but its start level "
        "(--tank-start-kg) is unknown"
    ),
    "airframe unknown": (
        "no tank gauge: the pump's output could give the level, but the airframe is unknown"
    ),
    # Files, clocks and stretches
    "clock of the ground": (
        "no message carries the vehicle's clock: times are the ground computer's"
    ),
    "restarted": ("the vehicle restarted: its clock went from {before:.0f} s to {after:.0f} s"),
    "clock jumped": "the vehicle's clock jumped {jump:.0f} s ahead; older readings are stale",
    "restarts": ("time went backwards {count:.0f} time(s) (restart): each stretch is read alone"),
    "stretch without flight": ("no verdict on a stretch without flight, {total_duration} in all"),
    "stretches without flight": (
        "no verdict on {count:.0f} stretches without flight, {total_duration} in all"
    ),
    "stretch unreadable": "no verdict on a stretch between restarts: {reason}",
    "dropouts": "{count:.0f} dropouts while logging, {seconds:.1f} s in all",
    "copies dropped": ("{count:.0f} frame(s) came twice (a second link or router): copies dropped"),
    "several autopilots": (
        "more than one autopilot sends as system {system}: component {chosen} is read, component "
        "{others} is left out; give each aircraft its own id (SYSID_THISMAV)"
    ),
    "format by content": "{name} is a {format} file by its content, whatever its name says",
    "torn rows": "{count:.0f} torn row(s) are left out",
    "columns not used": "columns not used: {names}",
    "column of another unit": (
        "{name}: {outside:.0f} of {rows:.0f} rows are not within {low:g} to {high:g}{unit}: not "
        "used; a file columns.toml beside it states units"
    ),
    "not used": "in the log ({source}), not used: {why}",
    "no value": "never with a value",
    "of no known motor": "of no known motor",
    "no plausible value in time": "no value that can be believed or is in time",
    "no known unit": "none of its instances drives motors in a known unit",
    "all at 0 rpm": "all at 0 rpm",
    "not measured": "{monitor} {number:.0f} measures no {channel}",
    "further flights": "{count:.0f} flights in the file: the first is read, the others not",
}
