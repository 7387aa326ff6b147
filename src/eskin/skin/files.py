"""Skins in files: a folder with `skin.yaml` and `taxels.csv`, or one text."""

from contextlib import ExitStack
from pathlib import Path

from eskin.errors import SkinError
from eskin.files import atomic_path
from eskin.skin.directions import direction_problems
from eskin.skin.draft import MANIFEST, Draft, make_draft, read_draft
from eskin.skin.manifest import format_manifest, parse_manifest
from eskin.skin.presets import PRESETS
from eskin.skin.skin import Skin
from eskin.skin.table import format_table

# YAML's own mark for the end of a document; the taxels follow.
END = "...\n"


def load_skin(name_or_path: str | Path) -> Skin:
    """Load a preset by its name, or a skin from a folder.

    Args:
        name_or_path: a name in `PRESETS`, a folder with `skin.yaml`, or that file.

    Raises:
        SkinError: the first thing that is wrong, and how many more there are.
    """
    name = str(name_or_path)
    if name in PRESETS:
        return PRESETS[name].build()
    path = Path(name_or_path)
    if not path.exists():
        raise SkinError(
            f"no skin '{name}'; allowed a preset ({', '.join(PRESETS)}) or a folder "
            f"with {MANIFEST}"
        )
    return finish(read_draft(path), f"`eskin skin check {name}` lists them")


def save_skin(skin: Skin, folder: str | Path) -> None:
    """Write a skin into a folder, which is made where it does not exist."""
    folder = Path(folder)
    texts = {"taxels.csv": format_table(skin), MANIFEST: format_manifest(skin)}
    with ExitStack() as stack:
        parts = {
            name: stack.enter_context(atomic_path(folder / name)) for name in texts
        }
        for name, text in texts.items():
            parts[name].write_text(text, encoding="utf-8", newline="\n")


def skin_to_bytes(skin: Skin) -> bytes:
    """The whole skin as one text that stands alone; reading it gives the same bits."""
    return (format_manifest(skin) + END + format_table(skin)).encode()


def skin_from_bytes(data: bytes, source: str = "skin") -> Skin:
    """Read what `skin_to_bytes` wrote.

    Args:
        data: the text.
        source: what to call it in messages, such as the recording it came from.

    Raises:
        SkinError: the first thing that is wrong, and how many more there are.
    """
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise SkinError(f"{source}: byte {error.start} is not UTF-8") from None
    head, mark, table = text.partition("\n" + END)
    if not mark:
        raise SkinError(f"{source}: got no line '...' between patches and taxels")
    manifest = parse_manifest(head, source)
    return finish(make_draft(manifest, table, f"{source}, taxels"), "mend its source")


def finish(draft: Draft, remedy: str) -> Skin:
    """The skin of a draft that has no problems."""
    problems = list(draft.problems) or direction_problems(draft.skin)
    if problems:
        more = f" (and {len(problems) - 1} more; {remedy})" if problems[1:] else ""
        raise SkinError(f"{problems[0]}{more}")
    return draft.skin
