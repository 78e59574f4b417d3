"""The next flight: of a small library of manoeuvres the one that would distinguish most."""
