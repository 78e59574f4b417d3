"""The workshop: what engineers and maintainers use. Every folder is one extra, as in the office."""
