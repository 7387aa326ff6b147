"""Golden answers: what the software computes from fixed seeds, kept and compared.

`python -m benchmarks.golden write FOLDER` computes the answers and keeps them;
`python -m benchmarks.golden check FOLDER` computes them anew and compares. Files must
be equal byte for byte, numbers to 1e-6. Both must run on the same machine. The script
goes away when the renaming is done.
"""

import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from safetensors.numpy import load_file

from eskin import MountedSkin, Recognizer, load_robot, read_recording
from eskin.demo.headless import DemoConfig, run_headless
from eskin.drivers import (
    Assembler,
    Data,
    EventLog,
    FixedJoints,
    Hello,
    decode_packet,
    encode_packet,
)
from eskin.model import load_model, save_model
from eskin.recording import Recording
from eskin.units import NS_PER_S

DATA = Path("../shared/data")
TOLERANCE = 1e-6
TRAIN = (
    "--train.epochs 1 --train.steps 50 --train.batch 32 --train.validation 0.2 "
    "--train.network.width 16 --train.network.layers 2 --train.workers 1 --skins 1"
).split()

Answers = dict[str, np.ndarray]


@dataclass(frozen=True)
class Command:
    """Write the golden answers, or check against them."""

    task: tyro.conf.Positional[Literal["write", "check"]]
    """What to do."""

    folder: tyro.conf.Positional[Path]
    """Where the answers are kept, with the weights that gave them."""

    parts: tuple[str, ...] = ()
    """Which answers; all unless given."""


def main() -> None:
    """Write or check."""
    command = tyro.cli(Command)
    command.folder.mkdir(parents=True, exist_ok=True)
    model = command.folder / "model.safetensors"
    if not model.exists():
        save_model(model, load_model("ur5"))
    wrong = 0
    with tempfile.TemporaryDirectory() as place:
        for name, part in PARTS.items():
            if command.parts and name not in command.parts:
                continue
            answers = part(Path(place), model)
            file = command.folder / f"{name}.npz"
            if command.task == "write":
                np.savez_compressed(file, **answers)  # type: ignore
                print(f"{name}: {len(answers)} answers written", flush=True)
            else:
                with np.load(file) as kept:
                    found = list(differences(dict(kept), answers))
                wrong += len(found)
                print(
                    f"{name}: {len(answers)} answers, {len(found)} differ", flush=True
                )
                for line in found[:10]:
                    print(f"  {line}")
    sys.exit(1 if wrong else 0)


def differences(kept: Answers, now: Answers) -> Iterator[str]:
    """Describe each answer that is not the same."""
    for name in sorted({*kept, *now}):
        if name not in kept or name not in now:
            yield f"{name} is only {'now' if name in now else 'kept'}"
        elif kept[name].shape != now[name].shape:
            yield f"{name} has shape {now[name].shape}, kept {kept[name].shape}"
        elif kept[name].dtype.kind == "f":
            if not np.allclose(
                now[name], kept[name], rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True
            ):
                most = np.nanmax(np.abs(now[name] - kept[name]))
                yield f"{name} differs by {most:.2e}"
        elif not np.array_equal(kept[name], now[name]):
            yield f"{name} is not equal"


def run_eskin(*words: object) -> dict[str, object]:
    """Run a command of eskin and return its JSON."""
    call = "import sys; from eskin.cli.main import main; sys.exit(main())"
    args = [sys.executable, "-c", call, *map(str, words), "--json"]
    done = subprocess.run(args, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"eskin {' '.join(map(str, words))}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def digest(data: bytes) -> np.ndarray:
    """Return SHA-256 of some bytes."""
    return np.frombuffer(hashlib.sha256(data).digest(), np.uint8)


def digests(folder: Path) -> Answers:
    """Return the digest of every recording below a folder."""
    files = sorted(folder.rglob("*.mcap"))
    return {str(f.relative_to(folder)): digest(f.read_bytes()) for f in files}


def made(place: Path, name: str, clips: int) -> Path:
    """Return a generated set."""
    folder = place / f"{name}-{clips}"
    if not folder.exists():
        run_eskin("generate", folder, "--set", name, "--clips", clips)
    return folder


def generated(place: Path, model: Path) -> Answers:
    """200 clips of worn builds and moving arms, 10 streams, 20 pairs."""
    folders = [
        made(place, name, count)
        for name, count in [("test-m", 200), ("streams", 10), ("pairs", 20)]
    ]
    return {
        f"{folder.name}/{name}": value
        for folder in folders
        for name, value in digests(folder).items()
    }


def recognised(place: Path, model: Path) -> Answers:
    """Logits and detections of the weights that come with eskin, reading by reading."""
    out: Answers = {}
    for folder in (made(place, "test-m", 200), made(place, "streams", 10)):
        for file in sorted(folder.rglob("*.mcap")):
            name = f"{folder.name}/{file.stem}"
            logits, detections = replayed(read_recording(file), model)
            out[f"{name}/logits"] = logits
            out[f"{name}/detections"] = digest(detections.encode())
    return out


def replayed(recording: Recording, model: Path) -> tuple[np.ndarray, str]:
    """Return all logits of a recording, and its detections as text."""
    mounted = MountedSkin(recording.skin, load_robot(recording.robot_name))
    recognizer = Recognizer.load(
        model, mounted.skin, mounted.robot, recording.calibration
    )
    logits, lines = [], []
    for scan in recording.scans():
        for found in recognizer.push(scan):
            said = asdict(found)
            lines.append(
                " ".join(f"{key}={said[key]}" for key in ("stamp", "touch", "gesture"))
                + f" {found.confidence:.5f} {found.patch}"
            )
        for key, value in sorted(recognizer.logits.items()):
            logits.append([float(scan.stamp % 10**12), float(key), *value])
    return np.array(logits), "\n".join(lines)


def evaluated(place: Path, model: Path) -> Answers:
    """Scores of the same recordings by the torch network and by events."""
    folders = made(place, "test-m", 200), made(place, "streams", 10)
    scores = run_eskin("evaluate", model, *folders)
    return {"scores": digest(json.dumps(scores, sort_keys=True).encode())}


def trained(place: Path, model: Path) -> Answers:
    """Weights after 50 steps."""
    out = place / "trained.safetensors"
    run_eskin("train", made(place, "test-m", 200), "--out", out, *TRAIN)
    return dict(load_file(out))


def converted(place: Path, model: Path) -> Answers:
    """A sleeve and a ShearSense recording."""
    out: Answers = {}
    sleeve = sorted((DATA / "sleeve").glob("*.json.gz"))[0]
    shear = sorted((DATA / "shearsense" / "poke").rglob("*"))
    sources = {"sleeve": sleeve, "shearsense": DATA / "shearsense"}
    if not sleeve.exists() or not shear:
        raise RuntimeError(f"{DATA} lacks recordings")
    for kind, source in sources.items():
        run_eskin("convert", kind, source, place / kind)
        out |= {f"{kind}/{k}": v for k, v in digests(place / kind).items()}
    return out


def assembled(place: Path, model: Path) -> Answers:
    """What an assembler makes of the packets of three modules that jitter and lose."""
    from eskin import load_skin

    skin, rng = load_skin("ur5"), np.random.default_rng(0)
    log = EventLog()
    joints = FixedJoints(np.zeros(6))
    assembler = Assembler(skin, joints, log)
    assembler.start(NS_PER_S, 50.0, None)
    arrivals = []
    for index, patch in enumerate(skin.patches):
        taxels = int((skin.patch_index == index).sum())
        phase = rng.uniform(0, 0.02)
        for number in range(500):
            true = phase + number / 50
            arrived = NS_PER_S + round(NS_PER_S * (true + rng.uniform(0.001, 0.006)))
            device = round(1e6 * true * (1 + 1e-5 * index))
            if number % 50 == 0:
                hello = Hello(
                    patch.address,
                    number,
                    device,
                    patch.rows,
                    patch.columns,
                    taxels,
                    50,
                    1 + index,
                    "golden",
                )
                arrivals.append((arrived, encode_packet(hello)))
            if rng.random() < 0.02:
                continue
            counts = rng.integers(0, 1023, taxels).astype(np.uint16)
            data = Data(patch.address, number, device, 0, counts)
            arrivals.append((arrived, encode_packet(data)))
    scans = []
    for arrived, packet in sorted(arrivals):
        while (due := assembler.next_deadline()) is not None and due <= arrived:
            scans += assembler.poll(due)
        assembler.push(decode_packet(packet), arrived, "a")
        scans += assembler.poll(arrived)
    return {
        "stamps": np.array([scan.stamp for scan in scans]),
        "counts": np.stack([scan.counts for scan in scans]),
        "received": np.stack([scan.received for scan in scans]),
        "events": digest("\n".join(e.kind for e in log.take()).encode()),
    }


def commanded(place: Path, model: Path) -> Answers:
    """Every decision about a simulated arm in four minutes of scripted touches."""
    score = run_headless(240, DemoConfig(model=str(model))).score
    lines = []
    for one in score.attempts:
        lines.append(
            f"{one.gesture} {one.expected} {one.begin} {one.end} {one.outcome}"
        )
        given = [*one.refusals, *([one.command] if one.command else [])]
        lines += [f"{c.stamp} {c.action} {c.touch} {c.accepted}" for c in given]
    lines += [f"{c.stamp} {c.action} {c.touch}" for c in score.false_alarms]
    return {
        "decisions": digest("\n".join(lines).encode()),
        "counts": np.array([score.commands, score.holds, len(score.attempts)]),
    }


PARTS: dict[str, Callable[[Path, Path], Answers]] = {
    "generated": generated,
    "recognised": recognised,
    "evaluated": evaluated,
    "trained": trained,
    "converted": converted,
    "assembled": assembled,
    "commanded": commanded,
}


if __name__ == "__main__":
    main()
