"""The pages are short enough to read, and their commands run as they stand there."""

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.models.model.model_file import load_model
from thrustmargin.models.physics.airframe import load_airframe

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "docs/your-aircraft.md").read_text(encoding="utf-8")


def commands(variable: str | None = None) -> list[list[str]]:
    """Words of each command of the blocks that use the folder `variable`, or none."""
    blocks = re.findall(r"```console\n(.*?)```", TEXT, re.S)
    mine = [
        b for b in blocks if (f"${variable}/" in b if variable else "$" not in b.replace("$ ", ""))
    ]
    lines = "".join(mine).replace("\\\n", " ").splitlines()
    return [shlex.split(os.path.expandvars(line))[2:] for line in lines if line.startswith("$ ")]


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    """Two folders of a user's own, beside the bundled flights."""
    made = {name: tmp_path_factory.mktemp(name) for name in ("route", "pages")}
    for folder in made.values():
        (folder / "sitl_logs").symlink_to(ROOT / "sitl_logs")
    return made


@pytest.fixture
def somewhere(folders, monkeypatch) -> Path:
    """Where the commands of a route leave their files for the next ones."""
    monkeypatch.chdir(folders["route"])
    return folders["route"]


@pytest.fixture
def beside(folders, monkeypatch) -> Path:
    """Where the pages' own commands are run."""
    monkeypatch.chdir(folders["pages"])
    return folders["pages"]


def test_every_block_of_commands_is_run_by_a_test():
    found = sum(len(commands(v)) for v in (None, "QUIVER", "QUAD", "HEXA"))
    assert found == len(re.findall(r"^\$ thrustmargin", TEXT, re.M)) >= 15


def test_the_route_on_bundled_flights_ends_in_a_checked_airframe_and_a_report(somewhere, capsys):
    *before, last = commands()
    assert last[0] == "identify"
    for words in before:
        assert run(words) == 0, words
    craft = load_airframe("my-f16.toml")
    assert craft.thrust_coefficient * 1.225 / craft.reference_density == pytest.approx(
        2.011e-5, rel=0.015
    )
    assert "look" not in capsys.readouterr().out
    assert (somewhere / "my-f16.html").exists()


@pytest.mark.slow
def test_the_route_on_bundled_flights_ends_in_a_model_that_knows_the_worn_propeller(
    somewhere, capsys
):
    """Goes on where the one before ends."""
    assert run(commands()[-1]) == 0
    assert "a weak rotor 1 (front right)" in capsys.readouterr().out
    effects = load_model(somewhere / "my-f16.safetensors").effects
    (worn,) = (e for e in effects if e.name == "rotor_degradation")
    low, high = worn.parameters["loss"].ci95
    assert worn.rotor == 1
    assert low - 0.003 < 0.08 < high + 0.003


@pytest.mark.slow
@pytest.mark.measured
@pytest.mark.usefixtures("somewhere")
@pytest.mark.parametrize(
    ("variable", "folder"),
    [
        ("QUIVER", "quiver_pt1"),
        ("QUAD", "cut_propeller_quad"),
        ("HEXA", "../sitl_logs/hexa"),
    ],
)
def test_the_routes_on_measured_flights_run(variable, folder, measured_folder, monkeypatch):
    if not (measured_folder / folder).is_dir():
        pytest.skip(f"no {folder} in the folder of measured data")
    monkeypatch.setenv(variable, str((measured_folder / folder).resolve()))
    for words in commands(variable):
        assert run(words) == 0, words


#: The longest sentence that a reader whose first language is not English takes in at once, words.
MOST_WORDS = 24


def pages() -> list[Path]:
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def prose(text: str) -> str:
    """Paragraphs and list items of a page, one a line, without code, tables, pictures, headings."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    lines: list[str] = [""]
    for line in text.splitlines():
        if re.match(r"\s*$|\s*\||#|!\[", line):
            lines.append("")
        elif re.match(r"    ", line) and not lines[-1]:
            continue  # code
        elif re.match(r"\s*(-|\d+\.) ", line):
            lines.append(re.sub(r"^\s*(-|\d+\.) ", "", line))
        else:
            lines[-1] = f"{lines[-1]} {line.strip()}".strip()
    return "\n".join(line for line in lines if line)


def sentences(text: str) -> list[str]:
    """Sentences of a page; what stands in backticks is one word, of a link its text counts."""
    text = re.sub(r"`[^`]+`", "code", prose(text))
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return [s.strip() for s in re.split(r"(?<=[.!?])[*)]*\s+|\n", text) if s.strip()]


def words(sentence: str) -> int:
    return len(re.findall(r"\w\S*", sentence))


@pytest.mark.parametrize("page", pages(), ids=lambda p: p.name)
def test_no_sentence_of_a_page_is_longer_than_24_words(page: Path):
    long = [s for s in sentences(page.read_text(encoding="utf-8")) if words(s) > MOST_WORDS]
    assert long == []


def test_sentences_are_counted_across_lines_and_not_in_tables_or_code():
    text = "# A b\n\nOne two\nthree `a b c` [four five](x.md). Six.\n\n| a |\n\n    c d\n\n- e f\n"
    assert [words(s) for s in sentences(text)] == [6, 1, 2]


@pytest.mark.parametrize("page", pages(), ids=lambda p: p.name)
def test_a_row_of_a_table_has_as_many_cells_as_its_heading(page: Path):
    wrong, width = [], 0
    for line in page.read_text(encoding="utf-8").splitlines():
        cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
        wrong += [line] if cells and width and cells != width else []
        width = (width or cells) if cells else 0
    assert wrong == []


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda p: p.name)
def test_a_page_begins_with_the_task_of_its_reader(page: Path):
    first = re.sub(r"^# .*\n", "", page.read_text(encoding="utf-8")).strip()
    assert first.startswith("You want to "), first[:60]


def test_the_readme_fits_one_screen():
    assert len(re.findall(r"\S+", (ROOT / "README.md").read_text(encoding="utf-8"))) <= 450


#: What commands printed, in the one folder of this module.
PRINTED: dict[str, str] = {}
#: Commands that end by themselves and need nothing but the bundled flights.
SHOWN = (
    *("report", "fill", "inspect", "install", "forecast", "identify", "airframe", "learn"),
    *("fleet", "match"),
)


def shown(text: str) -> list[tuple[str, list[str]]]:
    """Each command of the indented blocks of a page, with the lines of output below it."""
    found: list[tuple[str, list[str]]] = []
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("    $ "):
            found.append((line[6:], []))
        elif line.startswith("    ") and found:
            found[-1][1].append(" ".join(line.split()))
        elif line.strip():
            found.append(("", []))
    return [(command, output) for command, output in found if command]


@pytest.mark.parametrize(
    "name",
    [
        "docs/companion.md",
        "docs/ground-stations.md",
        "docs/report.md",
        "docs/vehicle_script.md",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in (
                "README.md",
                "docs/fleet-page.md",
                "docs/fleet.md",
                "docs/identify.md",
                "docs/load.md",
                "docs/measured.md",
                "docs/motor-outputs.md",
                "docs/tables.md",
            )
        ),
    ],
)
def test_a_page_shows_what_its_commands_print(name: str, beside: Path, capsys):
    """A command that several pages show is run once."""
    commands_run = 0
    for command, output in shown((ROOT / name).read_text(encoding="utf-8")):
        program, *arguments = shlex.split(command)
        if command in PRINTED:
            printed = PRINTED[command]
        elif program != "thrustmargin":
            printed = subprocess.run(
                command, shell=True, cwd=beside, check=True, capture_output=True, text=True
            ).stdout
        elif arguments[0] in SHOWN:
            files = [
                sorted(map(str, Path().glob(a))) if a.startswith("sitl_logs") else [a]
                for a in arguments
            ]
            assert run([word for words in files for word in words]) == 0
            printed = capsys.readouterr().out
        else:
            continue
        PRINTED[command] = printed
        commands_run += 1
        for line in output:
            assert line in " ".join(printed.split()), command
    assert commands_run


def test_commands_are_read_with_the_lines_of_output_below_them():
    page = "Text\n\n    $ a b \\\n      c\n    d  e\n\nText\n\n    f\n"
    assert [(command.split(), output) for command, output in shown(page)] == [
        (list("abc"), ["d e"])
    ]


def test_every_link_goes_to_a_file_and_a_heading():
    for page in pages():
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
        for link in re.findall(r"\]\((?!http)([^)]+)\)", text):
            file, _, anchor = link.partition("#")
            target = (page.parent / file).resolve() if file else page
            assert target.exists(), f"{page.name}: {link}"
            if anchor:
                heads = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
                slugs = [re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in heads]
                assert anchor in slugs, f"{page.name}: {link}"
