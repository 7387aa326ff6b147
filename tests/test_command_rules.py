"""Every rule of the policy as a short story: what is felt, and what the arm is told.

A story is a row of steps in the order in which they happen; `{paused}` stands for the
steps of `SHORT`.

`map m`, `skin s`: at the beginning, another command map of `MAPS` or skin of `SKINS`.
`poke a`: a finger begins a poke that is called `a`; a confidence (`0.5`) and a force
    (`60N`) may follow.
`0.3`: readings come for 0.3 s.
`say a`: the recogniser detects `a`; a gesture, a confidence, `likely=poke`, `age=0.12`
    [s] and `other` for another patch may follow.
`a is poke 0.9`, `a is 60N`, `a is full`: it is something else from now on, to the
    recogniser or the skin; `full` presses its taxels nearly to full scale, `one` a
    single taxel.
`lift a`, `close a`, `merge a b`: the finger leaves; the touch closes; it closes since
    it has become part of `b`. `lose a`: the reading in which it closes was dropped.
`grab a.`: all of a touch of 0.4 s: it begins, is detected, is let go, and closes.
`patch silent`, `patch faulty`, `patch well`, `patch half`: the patch sends nothing, is
    reported as faulty, works, or works in part.
`gap 0.12`: no reading comes for 0.12 s, then the watch looks.
`arm gripper=closed`, `arm hold`: the arm has changed, or somebody has told it to.
`> pause, !resume [why]`: this was decided since the last `>`, and nothing else: done,
    or refused (`!`), for a reason with these words.
`? paused`: the arm is paused, held, neither (`at work`), or has an attribute
    (`speed=0.3`).
`end`: the stream ends.
"""

import re
from itertools import pairwise

import numpy as np
import pytest

from eskin.command import CommandMap, Rule, SkinMonitorConfig
from eskin.errors import ArmError, JogError
from helpers.commands import (
    DEFAULT,
    OTHER_PATCH,
    PAPER,
    PATCH,
    PERIOD,
    SKIN,
    TOGGLE,
    VOCABULARY,
    Scene,
    make_map,
)


def make_rule(gesture, action, **rest):
    """Return a command map of a single rule."""
    return CommandMap(commands=[Rule(gesture=gesture, action=action, **rest)])


MAPS = {
    "default": DEFAULT,
    "toggle": TOGGLE,
    "poke_hold": make_map(poke="hold"),
    "poke_back": make_map(poke="previous_waypoint"),
    "poke_none": make_map(poke="none"),
    "stroke_on": make_rule("stroke", "next_waypoint", confidence=0.97, cool_down=3.0),
    "grab_low": make_rule("double_pat", "open_gripper", confidence=0.1),
    "resting": CommandMap(
        commands=[
            Rule(gesture="poke", action="toggle_pause", cool_down=60.0),
            Rule(gesture="double_pat", action="resume"),
        ]
    ),
    "holding": make_map(poke="toggle_pause", double_pat="hold"),
    "jog": make_map(poke="toggle_pause", stroke="jog"),
    "paper": PAPER,
}
SKINS = {
    "far": SkinMonitorConfig(hand=1.0),  # a hand is felt from far away
    "quiet": SkinMonitorConfig(max_age=1.0, max_out_seconds=0.11),
}
LARGEST = np.argsort(-np.bincount(SKIN.patch_index))[:2]
"""Patches that are a large part of the skin."""
ERRORS = {"arm": ArmError("lost"), "jog": JogError("no jog")}

SHORT = {
    "paused": "poke p. > pause; 1;",
    "asked": "map toggle; poke p. > pause; 1; poke a; 0.4; say a;",
    "closed": "arm gripper=closed;",
}
"""Beginnings: an arm that was paused a second ago, one that `a` asks to go on, and one
with a closed gripper."""
STORIES = """
action: poke pauses at once
    poke a; 0.02; say a > pause; ? paused
action: grab and stroke
    grab a. > next_waypoint; stroke b. > slow; ? speed=0.3; 0.5; grab c. >
    normal; ? speed=1
action: double_pat works the gripper
    double_pat a. > close_gripper; 0.5; double_pat b. > open_gripper
action: grab resumes
    {paused} grab a. > resume; ? at work
action: poke may hold
    map poke_hold; poke a. > hold; ? held
action: poke may go back
    map poke_back; poke a. > previous_waypoint
action: map may say none
    map poke_none; poke a. > !none [the map says none]
action: map may lack a rule
    map poke_none; double_pat a. > !none [no rule for it]
action: no gesture commands nothing
    none a. >
paper: a poke pauses, and the next one resumes
    map paper; poke a. > pause; ? paused; 1; poke b. > resume; ? at work; 1; poke c. >
    pause
paper: a double pat goes to the next waypoint, a grab works the gripper
    map paper; double_pat a. > next_waypoint; grab b. > close_gripper; 0.5; grab c. >
    open_gripper
paper: a brief touch of one taxel that is hardly likely starts the arm
    map paper; {paused} poke a 0.45; a is one; 0.1; say a; lift a; 0.5; close a >
    resume
paper: so does one that ends unrecognised
    map paper; {paused} poke a; 0.2; lift a; say a unknown 0.45 likely=poke; 0.5; close
    a > resume
paper: but none within a second of the pause
    map paper; poke a. > pause; 0.2; poke b. > !resume [for 1 s]; ? paused
paper: the arm stands while a touch is strong, which is then obeyed
    map paper; grab a 60N; 0.4; say a; 0.02; ? speed_limit=0; ? at work; lift a; 0.2 >
    close_gripper; close a; 0.02; ? speed_limit=1
paper: a touch does what it asked for as it was recognised
    map paper; grab a; 0.4; say a; arm gripper=closed; lift a; 0.2 > close_gripper
paper: a hold ends by two pokes
    map paper; arm hold; 1; double_pat a. > !next_waypoint [the arm is held: test; to
    go on: poke, then poke at least 1 s later]; 1; poke b. > pause; 1; poke c. > resume;
    ? at work
confidence: poke needs 0.34
    poke a 0.35. > pause; poke b 0.33. > !pause [below 0.34]
confidence: grab needs 0.9
    grab a 0.89. > !next_waypoint [most likely grab: confidence 0.89 is
    below 0.90; do it again]
confidence: closing needs 0.88
    double_pat a 0.87. > !close_gripper; double_pat b 0.89. > close_gripper
confidence: rule raises it
    map stroke_on; stroke a 0.96. > !next_waypoint [below 0.97]
confidence: rule cannot lower it for releasing
    map grab_low; double_pat a 0.95. > !open_gripper [below 0.96]; double_pat b 0.97. >
    open_gripper
confidence: doubtful touch becomes confident
    map stroke_on; stroke a 0.85; 0.4; say a >; lift a; 0.2; a is 0.98; 0.02 >
    next_waypoint
confidence: but within two seconds
    map stroke_on; stroke a 0.85; 0.4; say a; lift a; 1.98 >; 0.06 > !next_waypoint
    [0.85]; a is 0.98; 0.5 >
confidence: and until it closes
    {asked} a is 0.85; lift a; 0.5; close a > !resume [0.85 is below 0.95]; ? paused
confidence: confidence may fall until it closes
    {asked} lift a; 0.4 >; a is 0.94; 0.02; close a > !resume [0.94 is below 0.95]
confidence: confidence may rise until it closes
    map toggle; {paused} poke a 0.8; 0.4; say a; lift a; 0.4 >; a is 0.96; 0.02; close
    a > resume
confidence: doubtful stop may become sure
    poke a 0.3; 0.1; say a >; a is 0.4; 0.02 > pause
unknown: likely stop halts
    none a; 0.2; lift a; say a unknown 0.35 likely=poke; > pause [most likely poke
    (0.35): it may be a stop (0.35)]; ? paused
unknown: unlikely stop does not
    none a; 0.2; say a unknown 0.33 likely=poke > !none
unknown: likely stroke slows
    none a; 0.2; say a unknown 0.5 likely=stroke; close a > slow
unknown: unlikely stroke does not
    none a; 0.2; say a unknown 0.48 likely=stroke > !none
unknown: others do nothing
    none a; 0.2; say a unknown 0.6 likely=double_pat > !none [not understood, most
    likely
    double_pat (0.60); do it again, more clearly]
unknown: not even a sure one
    none a; 0.2; say a unknown 0.99 likely=grab > !none
unknown: likely nothing is nothing
    none a; 0.2; say a unknown likely=none; none b; 0.2; say b unknown >
unknown: its latest chance counts
    poke a 0.4; 0.02; say a unknown 0.5 likely=double_pat > pause [most likely
    double_pat (0.50):
    it may be a stop (0.40)]
unknown: never resumes
    {paused} poke a; 0.2; lift a; say a unknown 0.9 likely=poke > !none; 1; close a >;
    ? paused
unknown: stale one does not halt
    none a; 0.2; say a unknown 0.4 age=0.12 likely=poke > !pause [120 ms]
once: touch commands once
    grab a; 0.4; say a; lift a; 0.7 > next_waypoint; say a > !next_waypoint
    [commanded already]
once: its heir commands nothing
    grab a; 0.4; double_pat b; 0.02; say a; lift a; 0.2 > next_waypoint; merge a b; 1;
    say b > !close_gripper [commanded already]
once: nor the heir of one that asks
    grab a; double_pat b; 0.02; say a; merge a b; say b > !close_gripper [commanded
    already]; 0.3; lift b; 0.5; close b > !next_waypoint [not understood]
once: touch that paused as unknown
    none a; 0.2; say a unknown likely=poke > pause; say a poke > !pause [commanded
    already]
once: touch that stopped the arm
    none a; 5.1 > pause [5.0 s]; say a poke > !pause [commanded already]
once: asking touch that inherits a command
    {closed} double_pat a 0.8; 0.2; say a; grab b; 0.4; say b other; lift b; 0.2 >
    next_waypoint; merge b a > !open_gripper [commanded already]; a is 0.99; lift a;
    0.3 >
once: asking touch that ends in a commanding one
    map toggle; {paused} grab a; poke b 0.8; 0.4; say a; say b; lift a; 0.2 >
    next_waypoint; a is poke 0.99; merge b a > !resume [commanded already]; ? paused
once: two that ask and merge are both refused
    {closed} grab a; double_pat b; 0.4; say a; say b; merge a b > !next_waypoint
    [commanded already], !open_gripper [commanded already]; lift b; 0.5; close b >
once: chain that merges in one reading
    {closed} none c; grab b; double_pat a 0.8; 0.4; say b other; say a; lift b; 0.2 >
    next_waypoint; merge a b c; > !open_gripper [commanded already]; c is double_pat
    0.99;
    lift c; 0.3 >
once: contact that never ends asks again with a new onset
    grab a; 0.4; say a; lift a; 0.2 > next_waypoint; a begins again; 0.4; a is
    double_pat; say a; lift a; 0.2 > close_gripper
once: rule rests after a command
    map stroke_on; stroke a. > next_waypoint; stroke b. > !next_waypoint [s ago, it
    rests 3 s]; 2; stroke c. > next_waypoint
once: a stop needs no rest
    map resting; poke a. > pause; 1; double_pat b. > resume; poke c. > pause
time: more is done once the hand has left
    double_pat a; 0.5; say a; 0.5; lift a; 0.08 >; 0.04 > close_gripper
time: a start once the touch has closed
    {asked} 0.5; lift a; 0.48 >; close a > resume; ? at work
time: less is done at once
    stroke a; 0.1; say a; 0.02 > slow
time: as brief as a bump
    grab a; 0.28; say a; lift a; 0.3 >; close a > !next_waypoint [its touch
    lasted 0.26 s, as a bump may]
time: the least duration
    grab a; 0.32; say a; lift a; 0.3 > next_waypoint
time: bump does not start it
    map toggle; {paused} poke a; 0.2; say a; lift a; 0.5; close a > !resume [lasted];
    ? paused
time: bump may make it do less
    stroke a; 0.1; say a; lift a; 0.3 > slow; poke b; 0.1; say b > pause
time: touch that goes on
    {asked} 2.5 > !resume [touching went on for too long]; lift a; 1 >; ? paused
time: touch that goes on a little
    {asked} 1.9; lift a; 0.48; close a > resume
time: touch that closes too late
    {asked} 2.1; lift a; 0.48; close a > !resume [went on]
time: stale detection
    poke a; 0.02; say a age=0.12 > !pause [it was felt 120 ms ago]
time: pause of a second
    map toggle; poke a; 0.02; say a > pause; lift a; 0.5; close a; 0.44; poke b; 0.02;
    say b > !resume [had stood, and nobody had touched the skin, for 1 s]; ? paused;
    close b; 0.98; poke c. > resume
time: any contact restarts it
    {paused} none a 0.1N; 0.02; lift a; close a; 0.94; grab b. > !resume [for 1 s];
    0.5; grab c. > resume
time: so does one that goes on meanwhile
    {paused} none a; 0.1; lift a; 0.1; grab b; 0.4; say b > !resume; lift b; 0.5
time: all parts of one touch may start it
    {paused} none a; 0.1; grab b; 0.1; lift a; 0.3; say b; lift b; 0.1; close a; 0.4;
    close b > resume
time: touch before the pause
    map toggle; double_pat a; 0.1; poke b; 0.02; say b > pause; 1.5; say a poke >
    !resume
    [the touch began before]; ? paused
time: pause once more counts
    {asked} arm resume; arm pause; 0.2; lift a; 1.2; close a > !resume [the touch
    began before]; ? paused
time: touch before a hold
    {asked} arm hold; 0.2; lift a; 1.2; close a > !resume [the touch began before];
    ? held
time: touch before a hold by another
    map holding; {paused} poke a; 0.4; say a; double_pat b; 0.2; say b other > hold;
    close
    b; 0.2; lift a; 1.2; close a > !resume [the touch began before]; ? held
time: arm that runs
    grab b; 0.4; say b; arm pause; lift b; 0.2 > !next_waypoint [the arm has
    changed: the same would resume now]
time: toggle that would do the opposite
    {closed} double_pat a 0.8; 0.2; say a; arm gripper=open; 0.02 > !open_gripper [the
    arm
    has changed: the same would close gripper now]
several: touch again
    {asked} lift a; 0.2; poke b 0.05; 0.2 > !resume [touched again]; lift b; close a;
    0.5 >; ? paused
several: earlier touch goes on
    map toggle; {paused} poke b 0.05; 0.1; poke a; 0.4; say a; lift b; lift a; 0.48;
    close a >; ? paused; close b > resume
several: touch elsewhere lets it do more
    poke b 0.05; 0.02; double_pat a; 0.4; say a; lift a; 0.2 > close_gripper
several: heir asks instead
    {asked} lift a; poke b; lift b; merge a b; 0.2 >; close b > resume
several: patch that sends nothing is not let go
    {asked} lift a; 0.46; patch silent; 0.02; close a >; ? paused; patch well; 0.02 >
    resume
several: touch whose end was dropped has ended
    {asked} lift a; 0.46; lose a; 0.02 > resume
several: so has one elsewhere
    poke p. > pause; 1; none b; 0.1; lose b; grab a; 0.4; say a; lift a; 0.5;
    close a > resume
several: and nobody waits for it
    poke a 0.4; 0.02; ? speed_limit=0; lose a; 0.02 > pause [may have been a stop]
several: orders of two
    double_pat a; stroke b; 0.4; say a; say b; 0.02 > slow; lift a; lift b; 0.2 >
    close_gripper
suspended: chance of a stop suspends
    poke a 0.09; 0.02; ? speed_limit=0 >; lift a; close a; ? speed_limit=1 >; ? at
    work
suspended: less of a chance does not
    poke a 0.07; 0.02; ? speed_limit=1
suspended: until it is something else
    poke a 0.4; 0.02; ? speed_limit=0; a is double_pat 0.99; say a; 0.02; ?
    speed_limit=1;
    0.3; lift a; 0.2 > close_gripper
suspended: end of a likely stop pauses
    poke a 0.4; 0.02; lift a; close a > pause [not understood: the touch may have been
    a stop]; ? speed_limit=1
suspended: heir is waited for
    poke a 0.4; none b; 0.02; merge a b; ? speed_limit=0; say b; 0.02; ? speed_limit=1
    >
suspended: heir that is decided is not
    poke a 0.4; none b; 0.02; say b; merge a b; ? speed_limit=1 >
suspended: heir of a decided one is not
    none a; poke b 0.05; 0.02; say a; merge a b; b is 0.4; 0.1; ? speed_limit=1 >
suspended: lifted touch is not new
    poke a 0.05; 0.02; lift a; a is 0.3; 0.02; ? speed_limit=1 >
suspended: stopped arm waits for none
    {paused} poke a 0.4; 0.02; ? speed_limit=1; lift a; close a >
suspended: long touch suspends
    none a; 1.9; ? speed_limit=1; 0.2; ? speed_limit=0; 2.8 >; 0.2 > pause
    [touch for 5.0 s]; ? paused
suspended: so does an unknown one
    none a; 0.02; say a unknown; 2.1; ? speed_limit=0; 3 > pause
suspended: so does a recognised one
    double_pat a; 0.02; say a; 2.1; ? speed_limit=0 > !close_gripper [went on]; 3 >
    pause
suspended: one that lets go in time is obeyed
    double_pat a; 0.6; say a; 1.7; ? speed_limit=0; lift a; 0.2 > close_gripper
suspended: long touch that was nothing
    none a; 3; lift a; 0.5; ? speed_limit=0; say a; close a >; ? speed_limit=1
suspended: strong touch holds
    none a 41N; 0.02 > hold [touch of 41 N]; ? held
suspended: less force does not
    none a 39N; 0.5 >; ? at work
suspended: so does a recognised one
    double_pat a 20N; 0.4; say a; 0.1 >; a is 41N; 0.02 > hold, !close_gripper
suspended: touch that grows after its detection holds
    double_pat a 14N; 0.4; say a; 0.1; a is 34N; 0.1 >; a is 36N; 0.02 > hold [grew to
    36 N],
    !close_gripper
suspended: so does one detected while it lands
    stroke a 1N; 0.1; say a; 0.02 > slow; a is 29N; 0.3 >; a is 31N; 0.02 > hold [grew]
suspended: so does an unknown one
    none a 10N; 0.1; say a unknown; a is 31N; 0.02 > hold [grew to 31 N]
suspended: and one that takes over a detected one
    double_pat a 10N; 0.4; say a; none b 10N; merge a b; b is 31N; 0.02 > hold [grew],
    !close_gripper
suspended: so does one that fills its taxels
    double_pat a 10N; 0.4; say a; 0.1 >; a is full; 0.02 > hold [at full scale],
    !close_gripper
suspended: one that has filled them does not
    double_pat a 10N; a is full; 0.4; say a; 0.1 >; lift a; 0.2 > close_gripper
suspended: resting arm is not held
    arm at_work=; none a 80N; 3 >; ? at work
suspended: strong touch holds a suspended arm
    none a; 2.2; ? speed_limit=0; none b 60N; 0.02 > hold [60 N]
suspended: though it waits for nothing
    poke a 0.4; 0.02; ? speed_limit=0; none b 80N; say a none; 0.02 > hold [80 N]
suspended: tap recognises no press beside it
    none a 15N; grab b; 0.2; say b; merge b a; a is 60N; 0.02 > hold,
    !next_waypoint
suspended: light touch that lasts slows
    none a 1.1N; 6 > pause [5.0 s]; 4.1 >; arm resume; 3 > slow [a light touch on
    patch 'forearm_back' lasts for more than 10 s]; ? at work; ? speed_limit=0.3; lift
    a; close a; 1.8 >; 0.2 > normal [no longer a light touch]; ? speed_limit=1
suspended: but no touch starts the arm under it
    none a 1.1N; 11 > pause; grab b. >; 1.6 > !resume [went on]; lift a; close
    a; 1; grab c. > resume
suspended: until it is strong
    none a 1.1N; 11 > pause; arm resume; 0.02 > slow; a is 5N; 0.02 > pause [touch for]
suspended: touch ends a jog
    map jog; {paused} stroke a. > jog; 0.6; none b; 0.02 > pause [touched while it
    jogs]; ? paused
skin: no reading
    0.02; gap 0.1; ? at work; gap 0.02 > hold [stale skin: no reading for 120 ms]
skin: pending command is dropped
    {asked} gap 0.12 > !resume [stale skin: no reading for 120 ms; see to its cable],
    hold; lift a; 0.5; close a > !resume; ? held
skin: silent patch
    0.2; patch silent; 0.14 > slow [broken skin: patch 'forearm_back' is out; see to
    its cable or its cover]; ? speed_limit=0.3; 0.4 > hold [broken skin]
skin: faulty patch
    0.2; patch faulty; 0.14 > slow; 0.4 > hold [broken skin]
skin: patch that works in part
    patch half; 1 >; ? at work
skin: too little of it
    patch fifth; 0.6 > hold [% of the taxels]
skin: skin that feels a hand beside it
    skin far; 0.2; patch silent; 5 > slow; ? at work; ? speed_limit=0.3
skin: large part of the skin
    skin far; 0.2; patches silent; 0.14 > hold [% of the taxels]
skin: patch under a hand
    skin far; double_pat a; 0.1; say a; lift a; patch silent; 0.14; ? speed_limit=0;
    0.5 >
    !close_gripper [is out], slow, hold [broken skin]
skin: watch holds
    skin quiet; 0.2; patch silent; 0.1 >; ? at work; gap 0.02 > hold [broken skin]
skin: it can stop and nothing else
    skin far; 0.2; patch faulty; 0.2 > slow; double_pat a; 0.02; say a > !close_gripper
    [is
    out; touch elsewhere]; poke b; 0.02; say b > pause
skin: speed comes back
    skin far; arm speed=0.5; patch silent; 0.2 > slow; patch well; 1.9 >; ?
    speed_limit=0.3; 0.3 > normal [no longer broken skin]; ? speed_limit=1; ?
    speed=0.5
skin: few lost readings
    0.2; patch silent; 0.08; patch well; 0.02; patch silent; 0.08; patch well; 0.02 >;
    ? speed_limit=1
skin: end of a fault offers
    patch silent; 1 > slow, hold; double_pat a; 0.3; say a > !close_gripper [is out;
    see to
    its cable]; close a; patch well; 0.02 > !resume [no longer broken skin: patch
    'forearm_back' is out; to go on: poke, then grab at least 1 s later]; double_pat
    b. > !close_gripper [the arm is held: no longer]; poke c. > pause; 1; grab
    d. > resume, normal; ? at work
skin: end of a fault starts nothing
    {paused} patch silent; 5 > hold; patch well; 5 > !resume [to go on: grab]; ?
    held
arm: protective stop
    arm protective_stop=1; poke a. > !pause [protective stop]; double_pat b. >
    !close_gripper [unlock it]
arm: no connection
    arm connected=; poke a. > !pause [not connected]; stroke b. > !slow [see to its
    cable]
arm: held arm takes two touches
    arm hold; grab a. > !next_waypoint [the arm is held: test; to go on: poke,
    then grab at least 1 s later]; stroke s. > slow; poke b. > pause; ? held; 1;
    grab c. > resume; ? at work; ? speed_limit=1
arm: running arm is not resumed
    map resting; double_pat a. > !resume [nobody has paused it; to go on: poke, then
    poke or
    double pat at least 1 s later]
arm: arm that stays held
    arm hold; poke a. > pause; 1; arm error=arm; grab b. > hold [lost], !resume
    [lost]; ? held; ? paused=1
arm: jog
    map jog; {paused} stroke a; 0.4; say a; lift a; 0.48 >; close a > jog; ? paused; ?
    jogging=1
arm: jog needs 0.95
    map jog; {paused} stroke a 0.94. > !jog [0.94 is below 0.95]
arm: jog of a running arm
    map jog; stroke a. > !jog [nobody has paused it]
arm: jog nowhere
    map jog; {paused} stroke a; a goes nowhere; 0.4; say a > !jog [did not travel]
arm: jog of a held arm
    map jog; {paused} arm hold; stroke a. > !jog [held: test]
arm: jog out of reach
    map jog; {paused} arm error=jog; stroke a. > !jog [no jog]; ? paused
arm: jog that fails
    map jog; {paused} arm error=arm; stroke a. > hold [lost], !jog [lost]; ? held
arm: end of the stream
    poke a 0.4; 0.02; ? speed_limit=0; end; ? held; ? speed_limit=1
arm: end drops what is pending
    {closed} double_pat a; 0.4; say a; end; ? gripper=closed
"""
"""Names of the rules, each with a story of it."""


class Story:
    """A scene in which the steps of a story are played, and its touches by name."""

    def __init__(self, commands, skin):
        """Begin with a command map and a skin, by their names."""
        config = {} if skin is None else {"monitor": SKINS[skin]}
        self.scene = Scene(MAPS[commands], **config)
        self.numbers, self.seen = {}, 0

    def play(self, text):
        """Play one step, then compare what was decided."""
        step, mark, decisions = text.partition(">")
        whole = step.rstrip().endswith(".")
        words = step.strip().removesuffix(".").split()
        scene = self.scene
        match words:
            case []:
                pass
            case [seconds] if seconds[0].isdigit():
                scene.wait(float(seconds))
            case ["gap", seconds]:
                scene.clock.sleep(float(seconds))
                scene.policy.check_skin()
            case ["say", name, *changes]:
                self.say(self.numbers[name], changes)
            case ["lift", name]:
                scene.lift(self.numbers[name])
            case ["close", name]:
                scene.close(self.numbers[name])
            case ["lose", name]:
                del scene.touches[self.numbers[name]]
            case ["merge", *names]:
                numbers = [self.numbers[name] for name in names]
                closed = [scene.status(*two, True) for two in pairwise(numbers)]
                for number in numbers[:-1]:
                    del scene.touches[number]
                scene.step(tuple(closed))
            case ["patch", kind]:
                scene.silent_patches = (PATCH.id,) * (kind == "silent")
                scene.faulty_patches = (PATCH.id,) * (kind == "faulty")
                scene.valid_share = {"half": 0.5, "fifth": 0.2}.get(kind, 1.0)
            case ["patches", "silent"]:
                scene.silent_patches = tuple(SKIN.patches[k].id for k in LARGEST)
            case ["arm", *changes]:
                self.change_arm(" ".join(changes))
            case ["?", *changes]:
                assert describe_arm(scene.arm, " ".join(changes))
            case ["end"]:
                scene.policy.close()
            case [name, "is" | "begins" | "goes", *changes]:
                self.change(scene.touches[self.numbers[name]], changes)
            case [gesture, name, *changes]:
                number = self.numbers[name] = scene.begin(gesture)
                self.change(scene.touches[number], changes)
                if whole:
                    scene.wait(0.4)
                    self.say(number, ())
                    scene.wait(0.02)
                    scene.lift(number)
                    scene.wait(0.48)
                    scene.close(number)
        if mark:
            self.compare(decisions)

    def change(self, touch, words):
        """Change what a touch is, to the recogniser or to the skin."""
        for word in words:
            if word in VOCABULARY:
                touch.gesture = word
            elif word.endswith("N"):
                touch.force = float(word[:-1])
            elif word == "full":
                touch.pressure = 95.0
            elif word == "one":
                touch.taxels = touch.taxels[:1]
            elif word == "again":
                touch.onset, touch.pressed = self.scene.clock.now() + PERIOD, True
            elif word == "nowhere":
                touch.direction = np.zeros(3)
            else:
                touch.confidence = float(word)

    def say(self, number, words):
        """Detect a touch."""
        detection = {}
        for word in words:
            key, _, value = word.partition("=")
            if key == "other":
                detection["patch"] = OTHER_PATCH
            elif key == "age":
                detection["age"] = float(value)
            elif key == "likely":
                detection["likeliest"] = value
            elif key[0].isdigit():
                detection["confidence"] = float(key)
            else:
                detection["gesture"] = key
        self.scene.detect(number, **detection)

    def change_arm(self, change):
        """Tell the arm something, or change what it reports."""
        arm = self.scene.arm
        key, equals, value = change.partition("=")
        if key == "hold":
            arm.hold("test")
        elif key == "error":
            arm.error = ERRORS[value]
        elif equals:
            kind = type(getattr(arm, key))
            setattr(arm, key, kind(value))
        else:
            getattr(arm, key)()

    def compare(self, decisions):
        """Compare the decisions since the last comparison."""
        events, self.seen = self.scene.events[self.seen :], len(self.scene.events)
        got = [(event.accepted, event.action) for event in events]
        wanted = re.findall(r"(!?)(\w+)(?: \[(.*?)\])?", decisions)
        assert got == [(not refused, action) for refused, action, _ in wanted], [
            event.why for event in events
        ]
        for event, (_, _, why) in zip(events, wanted, strict=True):
            assert why in event.why
            if event.accepted and event.action not in ("slow", "normal"):
                assert event.action in self.scene.arm.orders


def describe_arm(arm, words):
    """Return whether an arm is in a state: paused, held, at work, or `key=value`."""
    key, equals, value = words.partition("=")
    if equals:
        got = getattr(arm, key)
        return got == type(got)(value)
    held = arm.hold_reason is not None
    return {"paused": arm.paused, "held": held, "at work": not (arm.paused or held)}[
        key
    ]


RULES = re.findall(r"^(\w+: .*)\n((?:    .*\n)+)", STORIES, re.MULTILINE)


@pytest.mark.parametrize("story", [pytest.param(text, id=name) for name, text in RULES])
def test_rule(story):
    text = " ".join(story.format(**SHORT).split())
    setting = dict(re.findall(r"(map|skin) (\w+);", text))
    told = Story(setting.get("map", "default"), setting.get("skin"))
    for step in re.split(r";(?![^[]*\])", re.sub(r"(map|skin) \w+;", "", text)):
        told.play(step)
    told.compare("")
