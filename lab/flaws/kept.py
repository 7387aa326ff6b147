"""Keep results in a file of JSON lines, so that a long run goes on where it stopped."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lab.flaws.scoring import TouchScore
from lab.flaws.stream import BuildPlan, BuildResult
from lab.flaws.watch import RestCount


def append_result(path: Path, plan: BuildPlan, result: BuildResult) -> None:
    """Append the result of a plan."""
    line = json.dumps({"plan": asdict(plan), "result": asdict(result)})
    with path.open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def read_results(path: Path | None) -> Iterator[tuple[BuildPlan, BuildResult]]:
    """Yield the plans of a file and their results; nothing if there is no file."""
    if path is None or not path.exists():
        return
    for line in path.read_text(encoding="utf-8").splitlines():
        content = json.loads(line)
        yield BuildPlan(**content["plan"]), parse_result(content["result"])


def parse_result(content: Mapping[str, Any]) -> BuildResult:
    """Return the result of a line."""
    return BuildResult(
        content["row"],
        content["number"],
        RestCount(**content["start"]),
        RestCount(**content["rest"]),
        [TouchScore(**touch) for touch in content["touches"]],
    )
