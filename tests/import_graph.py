"""Who imports whom in the source: modules, the rooms they stand in, and the picture of the rooms.

A room is a folder below `models` or `gcs_plugin`, with the folders in it; `models`, `mission` and
`gcs_plugin` themselves are rooms too, and `gcs_plugin/api`, which is the name `thrustmargin`,
belongs to the last. Imports inside functions and those for type checkers alone count as any other:
whoever reads the module must know the one that it names.
`python -m tests.import_graph` prints the picture that stands in docs/architecture.md.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("models", "mission", "gcs_plugin")

Graph = dict[str, set[str]]


@cache
def modules() -> dict[str, Path]:
    """Dotted name without `thrustmargin.` -> file."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    }


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All of a source file's tree, its root first."""
    return tuple(ast.walk(ast.parse(path.read_text("utf-8"))))


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Every module that a source file imports; `a.b` also where it imports `b` from `a`."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "an import gives the whole name"
            assert node.module
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            own = {n for n in names if n.removeprefix("thrustmargin.") in modules()}
            yield from own or {node.module}


@cache
def module_graph() -> Graph:
    """Module -> the modules of this project that it imports."""
    known = modules()
    graph: Graph = {}
    for name, path in known.items():
        found = {m.removeprefix("thrustmargin.") for m in imported(path)}
        graph[name] = (found & known.keys()) - {name}
    return graph


def room(module: str) -> str:
    """The room in which a module stands, as in `models.physics` or `gcs_plugin.logs`."""
    parts = module.split(".")
    folder = parts if modules()[module].name == "__init__.py" else parts[:-1]
    return ".".join(p for p in folder[: 1 if parts[0] == "mission" else 2] if p != "api")


def rooms() -> dict[str, list[str]]:
    """Room -> its modules, of the rooms that hold more than a data folder's `__init__`."""
    found: dict[str, list[str]] = {}
    for module in modules():
        found.setdefault(room(module), []).append(module)
    return {
        name: held
        for name, held in found.items()
        if any(modules()[m].name != "__init__.py" for m in held)
    }


def room_graph() -> Graph:
    """Room -> the other rooms that its modules import."""
    return {
        name: {room(target) for m in held for target in module_graph()[m]} & rooms().keys() - {name}
        for name, held in rooms().items()
    }


def floors(graph: Graph) -> dict[str, int]:
    """Node -> 1 where it imports nothing, else one more than the highest that it imports.

    The graph must have no circle.
    """

    @cache
    def floor(node: str) -> int:
        return 1 + max((floor(n) for n in graph[node]), default=0)

    return {node: floor(node) for node in graph}


def picture(graph: Graph) -> str:
    """The rooms as a mermaid diagram; an arrow that follows from others is left out."""

    @cache
    def below(node: str) -> frozenset[str]:
        return frozenset(n for child in graph[node] for n in {child, *below(child)})

    lines = ["flowchart TD"]
    for package in PACKAGES:
        held = [name for name in graph if name.split(".")[0] == package]
        lines += [f"  subgraph {package}_folder[{package}/]"]
        lines += [f"    {name}[{name.split('.')[-1]}]" for name in held]
        lines += ["  end"]
    for name, targets in graph.items():
        implied = {n for target in targets for n in below(target)}
        lines += [f"  {name} --> {target}" for target in sorted(targets - implied)]
    return "\n".join(lines)


if __name__ == "__main__":
    print(picture(room_graph()))
