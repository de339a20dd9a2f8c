"""Dashboard and alerts use only metrics and labels that the page has; processes check the page."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from tests.docs.pages import CHECKOUT, blocks
from tests.support.metrics import DOCUMENTED, Described, documented

DASHBOARD = CHECKOUT / "config" / "grafana" / "rover.json"
PROMETHEUS = CHECKOUT / "config" / "prometheus"
COMPONENTS = ("executive", "orbiter", "console")
KNOWN = {name: each for component in COMPONENTS for name, each in documented(component).items()}
OF_PROCESSES = {
    "process_cpu_seconds_total": (),
    "process_resident_memory_bytes": (),
    "process_open_fds": (),
    "up": (),
    "rover_build_info": ("component", "version"),
}
ADDED = {"job", "instance"}
"""Labels that Prometheus adds to each sample."""
_SELECTED = re.compile(r"\b((?:rover|process)_\w+|up)\b(?:\{([^}]*)\})?")
_SUFFIX = re.compile(r"_(bucket|sum|count)$")


def panels() -> Iterator[dict[str, Any]]:
    return (each for each in json.loads(DASHBOARD.read_text())["panels"] if each["type"] != "row")


def rules() -> list[dict[str, Any]]:
    (group,) = yaml.safe_load((PROMETHEUS / "rover.rules.yaml").read_text())["groups"]
    rules: list[dict[str, Any]] = group["rules"]
    return rules


def labels_of(name: str) -> set[str]:
    """Return the labels of a metric; raise KeyError if there is none."""
    if name in OF_PROCESSES:
        return {*OF_PROCESSES[name], *ADDED}
    base = _SUFFIX.sub("", name)
    described: Described = KNOWN[base]
    is_histogram = described.kind == "histogram"
    assert is_histogram == (base != name), f"{name}: parts of a histogram"
    return {*described.labels, *ADDED, *(["le"] if name.endswith("_bucket") else [])}


def check(expression: str, legend: str) -> None:
    """Check the metrics and labels of an expression, and of the text that shows its result."""
    plain = expression.replace('"$asset"', '".*"')
    present = set[str]()
    for name, selected in _SELECTED.findall(plain):
        labels = labels_of(name)
        assert {part.group(1) for part in re.finditer(r"(\w+)\s*=", selected)} <= labels, name
        if KNOWN.get(name, Described("", "", (), "")).kind == "counter":
            assert re.search(rf"(rate|increase)\({name}", plain), f"{name}: a counter is not shown"
        present |= labels
    assert present, expression
    for grouped in re.findall(r"\bby \(([\w, ]+)\)", plain):
        names = set(re.findall(r"\w+", grouped))
        assert names <= present, expression
        present = names
    shown = set(re.findall(r"\{\{ ?\$?(?:labels\.)?(\w+)", legend)) - {"value"}
    assert shown <= present, (expression, legend)


@pytest.mark.parametrize("panel", list(panels()), ids=lambda panel: panel["title"])
def test_a_panel_shows_metrics_that_exist(panel: dict[str, Any]) -> None:
    assert panel["targets"]
    for each in panel["targets"]:
        check(each["expr"], each["legendFormat"])


def test_panels_do_not_overlap() -> None:
    cells = [
        (x, y)
        for each in panels()
        for x in range(each["gridPos"]["x"], each["gridPos"]["x"] + each["gridPos"]["w"])
        for y in range(each["gridPos"]["y"], each["gridPos"]["y"] + each["gridPos"]["h"])
    ]
    assert len(set(cells)) == len(cells)
    assert max(x for x, _ in cells) < 24


@pytest.mark.parametrize("rule", rules(), ids=lambda rule: rule["alert"])
def test_an_alert_tests_metrics_that_exist(rule: dict[str, Any]) -> None:
    check(rule["expr"], rule["annotations"]["summary"])
    assert rule["labels"]["severity"] in {"warning", "critical"}


def test_the_check_finds_what_does_not_exist() -> None:
    for wrong in (
        "rover_executive_ticks",
        'rover_executive_mode{link="direct"}',
        "sum by (fault) (rover_executive_goals)",
        "rover_executive_faults_total",
        "rover_executive_tick_duration_seconds",
    ):
        with pytest.raises((AssertionError, KeyError)):
            check(wrong, "")
    with pytest.raises(AssertionError):
        check("rover_executive_goals", "{{fault}}")


def test_prometheus_reads_the_addresses_of_the_page() -> None:
    settings = yaml.safe_load((PROMETHEUS / "prometheus.yaml").read_text())
    assert [(PROMETHEUS / each).exists() for each in settings["rule_files"]] == [True]
    page = DOCUMENTED.read_text()
    for job in settings["scrape_configs"]:
        ((target,),) = (each["targets"] for each in job["static_configs"])
        assert f"| `{job['job_name']}` | `http://{target}/metrics` |" in page
    (typed,) = blocks(DOCUMENTED, "console")
    for line in typed.splitlines():
        program, _, options = line.partition(" ")
        port = options.rpartition("--metrics ")[2]
        assert f"| `{program}` | `http://127.0.0.1:{port or 21080}/metrics` |" in page
