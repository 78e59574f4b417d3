"""The office: what fleet managers, planners and other programs use. Every folder is one extra.

An extra imports the core and never another extra. It names its commands in `COMMANDS` of its
`__init__`; the command line finds it there, and runs without it where the folder is deleted.
"""
