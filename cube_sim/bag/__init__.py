"""
`cube_bag`: offline work on bags, at a terminal.

Each command is a file with `SUMMARY`, `add_arguments` and `run`; `main` finds them, and turns
what goes wrong into a sentence and an exit code.
"""
