"""Check MAVLink 2 signatures of received frames, and sign the frames sent.

A signed frame ends in a link id (1 byte), a time stamp (6 bytes, little-endian, 10 µs since
2015-01-01 UTC) and the first 48 bits of SHA-256(key, frame up to and with the time stamp). Source:
MAVLink developer guide, "Message Signing". Two rules are stricter than pymavlink's.

First, the digest is checked before any state changes, so that a frame made with another key and a
time stamp in the future cannot make later good frames look old.

Second, a frame of unknown id is dropped, because its content cannot be checked later.
"""

from __future__ import annotations

import hashlib
import hmac
import stat
import string
import threading
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path

from thrustmargin.gcs_plugin.mavlink.frame import SIGNATURE, SIGNED, V1, V2, checksum
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.models.errors import LinkError
from thrustmargin.models.whole_file import regular

KEY_LENGTH = 32  # bytes
DIGEST_LENGTH = 6  # bytes
EPOCH_UNIX = 1_420_070_400  # s, 2015-01-01 UTC
TICKS = 100_000  # time stamps count 10 µs
#: A sender that was not heard before may be so far behind, in ticks: one minute.
NEW_STREAM_LAG = 60 * TICKS
HEADER = 10  # bytes of a MAVLink 2 header

Clock = Callable[[], int]


def signing_time() -> int:
    """Return the computer's clock in the unit of signatures: 10 µs since 2015-01-01 UTC."""
    return max(0, (time.time_ns() - EPOCH_UNIX * 10**9) // 10_000)


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningCounts:
    """The counts of frames by result; all but `accepted` were dropped."""

    accepted: int = 0
    unsigned: int = 0  # not signed at all; MAVLink 1 cannot be
    unknown_id: int = 0  # signed, of an id that is in no dialect here
    wrong_key: int = 0  # the digest does not agree: another key, or changed on the way
    replayed: int = 0  # not newer than the last good frame of the same stream
    stale: int = 0  # the first of its stream, and more than a minute behind
    malformed: int = 0  # no whole MAVLink frame

    @property
    def dropped(self) -> int:
        """Return the number of dropped frames."""
        return sum(astuple(self)) - self.accepted

    @property
    def reasons(self) -> str:
        """Return the reasons and counts of dropped frames in words; empty if none was dropped."""
        reasons = (
            ("unsigned", self.unsigned),
            ("signed with another key", self.wrong_key),
            ("replayed", self.replayed),
            ("more than a minute behind this computer's clock (is it right?)", self.stale),
            ("of unknown id", self.unknown_id),
            ("malformed", self.malformed),
        )
        return ", ".join(f"{count} {words}" for words, count in reasons if count)

    def __str__(self) -> str:
        return f"{self.accepted} frames with a good signature; dropped: {self.reasons or 'none'}"


class SigningFilter:
    """A filter that accepts new frames of known id signed with `key`, and counts the others.

    `clock` returns the present as `signing_time` does; None for a recording, whose first frames are
    as old as it is. Mutable and safe to call from several threads. Raise LinkError if the key has
    not 32 bytes.
    """

    def __init__(self, key: bytes, *, clock: Clock | None = signing_time) -> None:
        self._digest = hashlib.sha256(_checked(key))
        self._known = frozenset(layouts())
        self._clock = clock
        self._lock = threading.Lock()
        self._last: dict[tuple[int, int, int], int] = {}  # (system, component, link id) -> stamp
        self._latest = 0
        self._counts = dict.fromkeys(SigningCounts.__slots__, 0)

    @property
    def counts(self) -> SigningCounts:
        """Return the present counts."""
        with self._lock:
            return SigningCounts(**self._counts)

    @property
    def latest(self) -> int:
        """Return the largest time stamp of a good frame, which sent frames must exceed; 0 if
        none.
        """
        return self._latest

    def accept(self, frame: bytes, link: int = 0) -> bool:  # noqa: ARG002
        """Return True if a frame is signed with the key and new; count it by its result.

        `frame` are its bytes from magic byte to signature. `link`, the number of its socket, makes
        no difference: an accepted frame is a replay over every other link too.
        """
        verdict = self._verdict(frame)
        with self._lock:
            if verdict == "accepted":
                verdict = self._age_verdict(frame)
            self._counts[verdict] += 1
        return verdict == "accepted"

    def _verdict(self, frame: bytes) -> str:
        """Classify a frame by its bytes, without its age; return a field of SigningCounts.

        "accepted" if digest and id are good; "unsigned" for a whole MAVLink 1 frame or a MAVLink 2
        frame without signature; "malformed" for a wrong length or unknown flags; "wrong_key" or
        "unknown_id".
        """
        if len(frame) >= 8 and frame[0] == V1 and len(frame) == frame[1] + 8:
            return "unsigned"
        if len(frame) < HEADER + 2 or frame[0] != V2:
            return "malformed"
        signed = frame[2] & SIGNED
        if len(frame) != HEADER + frame[1] + 2 + (SIGNATURE if signed else 0):
            return "malformed"
        if not signed:
            return "unsigned"
        if frame[2] != SIGNED:
            return "malformed"
        digest = self._digest.copy()
        digest.update(frame[:-DIGEST_LENGTH])
        if not hmac.compare_digest(digest.digest()[:DIGEST_LENGTH], frame[-DIGEST_LENGTH:]):
            return "wrong_key"
        known = int.from_bytes(frame[7:10], "little") in self._known
        return "accepted" if known else "unknown_id"

    def _age_verdict(self, frame: bytes) -> str:
        """Classify a frame with a good digest by its time stamp: "accepted", "replayed" or "stale".

        It must be newer than the last of its stream (system, component, link id); the first of a
        stream may be a minute behind the present. An accepted stamp is stored.
        """
        link_id, stamp = frame[-SIGNATURE], int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], link_id)
        last = self._last.get(stream)
        if last is not None and stamp <= last:
            return "replayed"
        if last is None:
            # After the first accepted stream the vehicles give the time: ours may be wrong.
            present = self._latest or (0 if self._clock is None else self._clock())
            if stamp + NEW_STREAM_LAG < present:
                return "stale"
        self._last[stream] = stamp
        self._latest = max(self._latest, stamp)
        return "accepted"


class Signer:
    """A signer of sent frames; `after` returns a time stamp to exceed: a filter's `latest`.

    `link_id` lets receivers distinguish the streams of several senders. Mutable and thread-safe.
    """

    def __init__(
        self,
        key: bytes,
        *,
        link_id: int = 0,
        clock: Clock = signing_time,
        after: Clock | None = None,
    ) -> None:
        self._digest = hashlib.sha256(_checked(key))
        self._link_id = bytes([link_id])
        self._clock = clock
        self._after = after
        self._stamp = 0
        self._lock = threading.Lock()

    def sign(self, frame: bytes) -> bytes:
        """Return the MAVLink 2 frame with a new signature in place of any it had.

        Raise LinkError for a frame that cannot be signed: MAVLink 1, cut short, or of unknown id.
        """
        number = int.from_bytes(frame[7:10], "little")
        layout = layouts().get(number)
        if len(frame) < HEADER + 2 or frame[0] != V2 or len(frame) < HEADER + frame[1] + 2:
            raise LinkError("only whole MAVLink 2 frames can be signed")
        if layout is None:
            raise LinkError(f"a frame of id {number} cannot be signed: its checksum is not known")
        body = bytes([frame[1], frame[2] | SIGNED]) + frame[3 : HEADER + frame[1]]
        check = checksum(body, layout.crc_extra)
        with self._lock:
            backlog = 0 if self._after is None else self._after()
            self._stamp = max(self._stamp + 1, backlog + 1, self._clock())
            stamp = self._stamp.to_bytes(6, "little")
        signed = bytes([V2]) + body + check.to_bytes(2, "little") + self._link_id + stamp
        digest = self._digest.copy()
        digest.update(signed)
        return signed + digest.digest()[:DIGEST_LENGTH]


def _checked(key: bytes) -> bytes:
    if len(key) != KEY_LENGTH:
        raise LinkError(f"a signing key has 32 bytes, this one {len(key)}; see --signing-key-file")
    return key


@dataclass(frozen=True, slots=True)
class SigningKey:
    """A key from a file; `notes` are for people, and the key itself is never displayed."""

    key: bytes
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"SigningKey(<{len(self.key)} bytes>, notes={self.notes!r})"


def read_signing_key(path: Path) -> SigningKey:
    """Read the key in a file: 32 bytes, 64 hex digits, or a passphrase on one line.

    A passphrase becomes its SHA-256, as in MAVProxy and Mission Planner. A note warns if other
    users of the computer can read the file. Raise LinkError if the file contains none of these.
    """
    try:
        content = path.read_bytes() if regular(path).stat().st_size <= 4096 else b""
        mode = path.stat().st_mode
    except OSError as error:
        raise LinkError(f"signing key file {path} cannot be read: {error.strerror}") from error
    key = _key_in(content, path)
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        note = f"other users of this computer can read the signing key: chmod 600 {path}"
        return SigningKey(key, (note,))
    return SigningKey(key)


def _key_in(content: bytes, path: Path) -> bytes:
    if len(content) == KEY_LENGTH and not all(chr(b) in string.printable for b in content):
        return content
    try:
        lines = content.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        lines = []
    if len(lines) != 1 or not lines[0].strip():
        raise LinkError(
            f"signing key file {path} holds no key: it must be 32 bytes, 64 hex digits or one line "
            "with the passphrase"
        )
    text = lines[0]
    digits = text.strip()
    if len(digits) == 2 * KEY_LENGTH and all(c in string.hexdigits for c in digits):
        return bytes.fromhex(digits)
    if content == text.encode("utf-8") and len(content) == KEY_LENGTH:
        raise LinkError(
            f"signing key file {path} holds 32 letters, which may be a key or a passphrase: end "
            "the line for a passphrase, or write the key as 64 hex digits"
        )
    return hashlib.sha256(text.encode("utf-8")).digest()
