"""The page itself: its server, its door, its token."""
