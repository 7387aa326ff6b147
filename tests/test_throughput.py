"""`eskin bench throughput` on a tiny budget: what it says, not how fast it was."""

import json

import pytest

from eskin.bench import throughput as bench
from eskin.cli.main import run


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_readings_come_through_and_are_counted(over, capsys, monkeypatch):
    monkeypatch.setattr(bench, "SETTLE_S", 0.5)
    words = ["--rate", "50", "--seconds", "0.5", "--over", over, "--json"]
    assert run(["bench", "throughput", *words]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert set(result) == {"rate_hz", "dropped", "cpu", "rows"}
    assert result["cpu"] > 0
    [row] = result["rows"]
    assert (row["over"], row["asked_hz"]) == (over, 50.0)


def test_the_limit_lies_where_readings_first_drop(monkeypatch):
    tried = []

    def dropping(over, rate, seconds):
        tried.append(rate)
        return bench.ThroughputResult(
            over, rate, rate, int(rate > 3100), 0.5, 1.0, 1.0, 1.0, 0.3, 1, {}
        )

    monkeypatch.setattr(bench, "measure_throughput", dropping)
    assert 3100 < bench.find_limit("udp", 1000.0) <= 3250
    assert tried[:3] == [1000.0, 2000.0, 4000.0] and len(tried) == 7


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rate", "0"], "--rate is 0; allowed are 1 to 10000"),
        (["--seconds", "-1"], "--seconds is -1; allowed are above 0"),
        (["--over", "radio"], "radio"),
    ],
)
def test_what_cannot_be_measured_is_one_line(words, said, capsys):
    assert run(["bench", "throughput", *words]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
