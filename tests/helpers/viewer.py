"""Descriptions of a UR5 in its skin for the page, and updates of touches on it."""

from dataclasses import replace
from functools import cache

import numpy as np

from eskin.page import ContactMarker, OpenTouch, ViewUpdate
from eskin.page.appearance import describe_scene
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin

Q = np.array([0.4, -1.1, 1.4, -0.6, 0.9, 0.0])
GESTURES = ("none", "poke", "double_pat", "grab", "stroke")


@cache
def mounted():
    return MountedSkin(load_skin("ur5"), load_robot("ur5"))


@cache
def make_setup(touchable=True, is_arm=True):
    return replace(
        describe_scene(mounted(), GESTURES),
        touchable=touchable,
        skins=("ur5", "ur5-shapes"),
        is_arm=is_arm,
    )


def make_update(seconds=0.0, taxel=None, q=Q, log_entries=(), arm=None, question=None):
    """Return an update of the page; with a taxel, something presses there."""
    skin = mounted().skin
    pressure = np.zeros(skin.count, np.float16)
    contacts = touches = ()
    if taxel is not None:
        link = int(mounted().taxel_link_index[taxel])
        away = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
        near = (away < 0.02) & (mounted().taxel_link_index == link)
        pressure[near] = 40 * np.exp(-((away[near] / 0.012) ** 2))
        mark = ContactMarker(
            link,
            skin.positions[taxel],
            skin.normals[taxel],
            0.015,
            7.5,
            skin.patches[skin.patch_index[taxel]].id,
        )
        chances = np.array([0.01, 0.9, 0.05, 0.01, 0.03], np.float32)
        contacts = (mark,)
        touches = (OpenTouch(3, mark.patch, 7.5, chances),)
    return ViewUpdate(
        seconds=seconds,
        T_world_link=mounted().kinematics.poses(q),
        pressure=pressure,
        valid=np.ones(skin.count, bool),
        contacts=contacts,
        touches=touches,
        force=7.5 if contacts else 0.0,
        peak=float(pressure.max()),
        log_entries=tuple(log_entries),
        rate=50.0,
        step=2e-4,
        age=1e-3,
        arm=arm,
        question=question,
    )
