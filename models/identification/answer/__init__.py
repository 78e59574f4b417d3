"""The answer: what is named, with which error on flights left out, and what to fly next."""
