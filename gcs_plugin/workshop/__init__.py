"""Commands for engineers and maintainers; every folder is an extra, which can be deleted."""
