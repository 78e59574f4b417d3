"""Where made channels of tests come from."""

from typing import Any

from thrustmargin.models.provenance import Meaning, Provenance, SourceKind


def sent(words: str, **data: Any) -> Provenance:
    """A message and its fields, as `ATTITUDE roll, pitch, yaw`."""
    name, _, fields = words.partition(" ")
    fields = (fields,) if fields else ()
    return Provenance(kind=SourceKind.MESSAGE, name=name, fields=fields, **data)


def pulses(message: str) -> Provenance:
    """A message of servo outputs."""
    return sent(message, unit="us")


#: Of speeds that were made of motor outputs, in all rotors.
FROM_OUTPUTS = Provenance(kind=SourceKind.INFERRED, meaning=Meaning.MOTOR_OUTPUTS)
