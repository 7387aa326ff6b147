"""Is a set of links and joints one tree?"""

from collections import Counter
from collections.abc import Iterable, Sequence

from eskin.errors import RobotError

__all__ = ["check_tree"]

Edge = tuple[str, str, str]


def check_tree(robot: str, links: Sequence[str], joints: Sequence[Edge]) -> None:
    """Refuse links and joints (name, parent, child) that do not form one tree.

    Raises:
        RobotError: Names twice, unknown links, two parents, several roots or a cycle.
    """
    if not links:
        raise RobotError(f"robot '{robot}' has no links; at least one is needed")
    for kind, names in (("link", links), ("joint", [name for name, _, _ in joints])):
        if twice := repeated(names):
            raise RobotError(f"robot '{robot}' has {kind} '{twice}' twice; rename one")
    check_ends(robot, set(links), joints)
    if child := repeated([child for _, _, child in joints]):
        parents = sorted(name for name, _, c in joints if c == child)
        raise RobotError(
            f"robot '{robot}': link '{child}' hangs from several joints "
            f"({', '.join(parents)}); allowed: one"
        )
    check_connected(robot, links, joints)


def check_ends(robot: str, links: set[str], joints: Sequence[Edge]) -> None:
    """Refuse joints whose parent or child is no link."""
    for name, parent, child in joints:
        for end, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise RobotError(
                    f"robot '{robot}': joint '{name}' has unknown {end} link "
                    f"'{link}'; allowed: {', '.join(sorted(links))}"
                )


def check_connected(robot: str, links: Sequence[str], joints: Sequence[Edge]) -> None:
    """Refuse several roots, and links in a cycle."""
    parent_of = {child: parent for _, parent, child in joints}
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise RobotError(
            f"robot '{robot}' has several roots ({', '.join(roots)}); "
            "join them with fixed joints to leave one"
        )
    reached = set(roots)
    left = [link for link in links if link not in reached]
    while new := {link for link in left if parent_of[link] in reached}:
        reached |= new
        left = [link for link in left if link not in new]
    if left:
        raise RobotError(
            f"robot '{robot}': links {', '.join(left)} hang in a cycle; "
            "remove the joint that closes it"
        )


def repeated(names: Iterable[str]) -> str | None:
    """The first name that comes more than once."""
    return next((name for name, count in Counter(names).items() if count > 1), None)
