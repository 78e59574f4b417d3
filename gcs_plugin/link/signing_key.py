"""The file behind --signing-key-file."""

from __future__ import annotations

import hashlib
import stat
import string
from dataclasses import dataclass
from pathlib import Path

from thrustmargin.models.errors import LinkError

KEY_LENGTH = 32  # bytes


@dataclass(frozen=True, slots=True)
class SigningKey:
    """A key from a file. `notes` are for people; the key itself is never shown."""

    key: bytes
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"SigningKey(<{len(self.key)} bytes>, notes={self.notes!r})"


def read_signing_key(path: Path) -> SigningKey:
    """The key in a file: 32 bytes, 64 hex digits, or a passphrase on one line.

    A passphrase becomes its SHA-256, as in MAVProxy and Mission Planner. A note says so when other
    users of the computer can read the file. Raises LinkError when the file holds none of these.
    """
    try:
        content = path.read_bytes() if path.stat().st_size <= 4096 else b""
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
