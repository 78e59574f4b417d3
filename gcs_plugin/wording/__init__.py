"""Words, numbers, colours and actions for people: one place for every screen and language."""
