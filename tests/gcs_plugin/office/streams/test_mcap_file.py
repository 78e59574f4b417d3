"""The MCAP file of a flight, read back by the library of the format: the report's numbers."""

import csv
import io
import json
from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.gcs_plugin.reports.margin.report_flight import LOG, flight
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.findings import Severity
from thrustmargin.gcs_plugin.office.streams.mcap_file import (
    TOPICS,
    SortieClock,
    messages_of,
    sortie_clock,
    write_mcap,
)
from thrustmargin.gcs_plugin.reports.margin import report_flight
from thrustmargin.models.errors import DataError


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> SimpleNamespace:
    """The file, its messages by topic, the layout, and what `report` writes of the same log."""
    folder = tmp_path_factory.mktemp("mcap")
    out, layout = folder / "f.mcap", folder / "layout.json"
    assert run(["export", str(LOG), "--mcap", str(out), "--layout", str(layout)]) == 0
    assert run(["report", str(LOG), "--out", str(folder / "r.html")]) == 0
    topics: dict[str, list[tuple[int, dict]]] = {}
    with out.open("rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            held = topics.setdefault(channel.topic, [])
            held.append((message.log_time, json.loads(message.data)))
        (said,) = reader.iter_metadata()
        schemas = {
            c.topic: reader.get_summary().schemas[c.schema_id]  # type: ignore[union-attr]
            for c in reader.get_summary().channels.values()  # type: ignore[union-attr]
        }
    return SimpleNamespace(
        topics=topics,
        schemas=schemas,
        metadata=said.metadata,
        layout=json.loads(layout.read_text("utf-8")),
        report=json.loads((folder / "r.json").read_text("utf-8"))["flights"][0],
        rows=list(csv.DictReader(io.StringIO((folder / "r.csv").read_text("utf-8")))),
    )


def test_the_file_names_its_log_and_its_clock(written):
    assert written.metadata["log"] == LOG.name
    assert written.metadata["clock"] == "Unix"


@pytest.mark.slow
def test_the_report_is_in_it_as_its_json_has_it(written):
    assert [content for _, content in written.topics["/report"]] == [written.report]


def test_the_margin_of_the_worst_moment_is_that_of_the_report(written):
    worst = written.report["moments"][0]
    (found,) = [c for _, c in written.topics["/margin"] if c["time_s"] == worst["time_s"]]
    assert found["rotor"] == worst["rotor"]
    assert found["margin"] == worst["margin"]
    assert found["low"] == pytest.approx(1.0 - worst["capacity_use_high"], abs=1e-12)
    assert found["high"] == pytest.approx(1.0 - worst["capacity_use_low"], abs=1e-12)
    assert (found["basis"], found["least"]) == ("measured", 0.5)


def test_nothing_is_claimed_of_the_margin_on_the_ground(written):
    flying = {c["time_s"]: c["flying"] for _, c in written.topics["/flight"]}
    standing = [c for _, c in written.topics["/margin"] if not flying[c["time_s"]]]
    assert standing
    assert {(c["margin"], c["rotor"], c["basis"]) for c in standing} == {(None, None, "unknown")}


@pytest.mark.parametrize("name", ["tank_kg", "voltage", "ground_speed"])
def test_channels_are_those_of_the_csv(written, name: str):
    (heading,) = [h for h in written.rows[0] if h.startswith(f"{name} [")]
    theirs = [float(row[heading]) if row[heading] else None for row in written.rows]
    assert [c[name] for _, c in written.topics["/flight"]] == pytest.approx(theirs, abs=6e-4)


def test_every_rotor_has_its_speeds_and_use_as_the_csv(written):
    for key in ("rotor_speed_rpm", "rotor_speed_predicted_rpm", "utilisation"):
        for rotor in (1, 4):
            (heading,) = [h for h in written.rows[0] if h.startswith(f"{key}_{rotor} [")]
            theirs = [float(row[heading]) if row[heading] else None for row in written.rows]
            ours = [c["rotors"][rotor - 1][key] for _, c in written.topics["/rotors"]]
            assert ours == pytest.approx(theirs, abs=0.06)
    heads = {
        tuple((r["rotor"], r["name"]) for r in c["rotors"]) for _, c in written.topics["/rotors"]
    }
    assert heads == {((1, "front right"), (2, "rear left"), (3, "front left"), (4, "rear right"))}


def test_the_position_is_in_degrees_and_dated(written):
    stamp_ns, first = written.topics["/position"][0]
    assert first["latitude"] == pytest.approx(36.65, abs=0.01)
    assert first["longitude"] == pytest.approx(116.9, abs=0.01)
    assert first["timestamp"] == {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}
    began = datetime.fromisoformat(written.report["flight"]["start_utc"])
    assert stamp_ns * 1e-9 == pytest.approx(began.timestamp(), abs=1.0)


def test_findings_and_texts_are_in_it(written):
    found = [{k: v for k, v in c.items() if k != "sortie"} for _, c in written.topics["/findings"]]
    key = json.dumps
    assert sorted(found, key=key) == sorted(written.report["findings"], key=key)
    said = [c["message"] for _, c in written.topics["/log"] if c["name"] == "vehicle"]
    assert sorted(said) == sorted(text for _, text in written.report["quality"]["messages"])


@pytest.mark.parametrize("topic", sorted(TOPICS))
def test_every_key_of_a_message_is_in_its_schema(written, topic: str):
    schema = json.loads(written.schemas[topic].data)
    for _, content in written.topics[topic]:
        assert content.keys() == schema["properties"].keys()


def test_the_order_of_time_is_that_of_the_file(written):
    stamps = [stamp for stamp, _ in written.topics["/margin"]]
    assert stamps == sorted(stamps)
    assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx(219.8, abs=0.1)


def paths_of(layout: dict) -> list[str]:
    plots = [p for name, p in layout["configById"].items() if name.startswith("Plot!")]
    return [line["value"] for plot in plots for line in plot["paths"]]


def test_every_line_of_the_layout_has_numbers_in_the_file(written):
    paths = paths_of(written.layout)
    assert len(paths) == 4 + 4 + 8 + 2
    for path in paths:
        topic, *keys = path.replace("[", ".").replace("]", "").split(".")
        values = []
        for _, content in written.topics[topic]:
            for key in keys:
                content = content[int(key)] if key.isdigit() else content[key]
            values.append(content)
        assert any(isinstance(value, float) for value in values), path


def test_every_panel_of_the_layout_is_placed(written):
    def placed(node) -> list[str]:
        return [node] if isinstance(node, str) else placed(node["first"]) + placed(node["second"])

    assert sorted(placed(written.layout["layout"])) == sorted(written.layout["configById"])


def test_without_a_date_the_times_count_from_the_vehicles_start():
    log = read_log(LOG)
    undated = replace(log, track=replace(log.track, start_unix_s=None))
    clock = sortie_clock(undated)
    assert not clock.unix
    assert clock.stamp_ns(2.0) == round((log.clock_start_s + 2.0) * 1e9)


def test_margins_their_interval_and_basis_by_hand():
    """Rotors at 40 % with an interval of 30 to 60 %: a margin of 60 % between 40 and 70."""
    report = report_flight(*flight(), max_utilisation=0.3)
    shape = report.rows["known_utilisation"].shape
    use = {"known_utilisation": 0.4, "utilisation_low": 0.3, "utilisation_high": 0.6}
    values = {name: np.full(shape, value) for name, value in use.items()}
    values["flying"] = np.ones(shape[0])
    spoken = {
        "utilisation": np.full(shape, np.nan),
        "utilisation_from_outputs": np.full(shape, 0.4),
    }
    made = replace(report, rows={**report.rows, **values, **spoken})
    of = next(m.content for m in messages_of(made, flight()[1]) if m.topic == "/margin")
    assert (of["margin"], of["low"], of["high"]) == pytest.approx((0.6, 0.4, 0.7))
    assert (of["least"], of["basis"]) == (pytest.approx(0.7), "from motor outputs")


def test_a_grave_finding_is_fatal_to_foxglove():
    report, log = report_flight(*flight(), max_utilisation=0.5), flight()[1]
    grave = replace(report.json["findings"][0], level=Severity.GRAVE)
    lines = messages_of(replace(report, json={**report.json, "findings": (grave,)}), log)
    (level,) = {m.content["level"] for m in lines if m.content.get("name") == grave.check}
    assert level == 5


def test_times_have_the_64_bits_of_the_format():
    stamps = [SortieClock(start_s=s, unix=True).stamp_ns(0.0) for s in (-1.0, 1e10, 1e11)]
    assert stamps == [0, 10**19, 2**64 - 1]


def test_sorties_of_which_one_alone_has_a_date_share_no_file(tmp_path):
    report, log = report_flight(*flight(), max_utilisation=0.5), flight()[1]
    undated = replace(log, track=replace(log.track, start_unix_s=None))
    with pytest.raises(DataError, match="the date is known of some"):
        write_mcap([(report, log), (report, undated)], tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []
