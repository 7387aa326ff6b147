"""Every rule of the policy as a short story: what is felt, and what the arm is told.

A story is a row of steps in the order in which they happen; `{paused}` stands for the
steps of `SHORT`.

`map m`, `skin s`: at the beginning, another command map of `MAPS` or skin of `SKINS`;
    nothing has touched the skin for a second by then.
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
`ask grab`: all of a grab, and half a second later a poke that answers.
`press a`: a touch closes, and something presses its taxels on.
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
    HELD,
    OTHER_PATCH,
    PAPER,
    PATCH,
    PERIOD,
    SKIN,
    VOCABULARY,
    Scene,
    make_map,
)


def make_rule(gesture, action, **rest):
    """Return a command map of a single rule."""
    return CommandMap(commands=[Rule(gesture=gesture, action=action, **rest)])


MAPS = {
    "default": DEFAULT,
    "poke_hold": make_map(poke="hold"),
    "stroke_back": make_map(poke="pause", stroke="previous_waypoint"),
    "poke_none": make_map(poke="none"),
    "stroke_on": make_rule("stroke", "next_waypoint", confidence=0.97, cool_down=3.0),
    "pat_low": make_rule("double_pat", "open_gripper", confidence=0.1),
    "resting": CommandMap(
        commands=[
            Rule(gesture="poke", action="pause", cool_down=60.0),
            Rule(gesture="double_pat", action="resume"),
        ]
    ),
    "resting_slow": make_rule("stroke", "slow", cool_down=60.0),
    "jog": make_map(poke="pause", stroke="jog"),
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
    "asked": "poke p. > pause; 1; grab a; 0.4; say a;",
    "asks": "poke p. > pause; 1; grab a. >; ? shows_question=1;",
    "closed": "arm gripper=closed;",
}
"""Beginnings: an arm that was paused a second ago, one that `a` asks to go on, one that
asks back, and one with a closed gripper."""
STORIES = """
action: poke pauses at once
    poke a; 0.02; say a > pause; ? paused
action: grab and stroke
    ask grab > next_waypoint; stroke b. > slow; ? speed=0.3; 1; ask grab > normal; ?
    speed=1
action: double_pat works the gripper
    ask double_pat > close_gripper; 1; ask double_pat > open_gripper
action: grab resumes
    {paused} ask grab > resume; ? at work
action: poke may hold
    map poke_hold; poke a. > hold; ? held
action: stroke may go back
    map stroke_back; ask stroke > previous_waypoint
action: map may say none
    map poke_none; poke a. > !none [the map says none]
action: map may lack a rule
    map poke_none; double_pat a. > !none [no rule for it]
action: no gesture commands nothing
    none a. >
never: a poke pauses, and the next one resumes
    map paper; poke a. > pause; ? paused; 1; poke b. > resume; ? at work; 1; poke c. >
    pause
never: a double pat goes to the next waypoint, a grab works the gripper
    map paper; double_pat a. > next_waypoint; grab b. > close_gripper; 0.5; grab c. >
    open_gripper
never: a brief touch of one taxel that is hardly likely starts the arm
    map paper; {paused} poke a 0.45; a is one; 0.1; say a; lift a; 0.5; close a >
    resume
never: so does one that ends unrecognised
    map paper; {paused} poke a; 0.2; lift a; say a unknown 0.45 likely=poke; 0.5; close
    a > resume
never: but none within a second of the pause
    map paper; poke a. > pause; 0.2; poke b. > !resume [1 s before]; ? paused
never: the arm stands while a touch is strong, which is then obeyed
    map paper; grab a 60N; 0.4; say a; 0.02; ? speed_limit=0; ? at work; lift a; 0.2;
    close a > close_gripper; ? speed_limit=1
never: a touch does what it asked for as it was recognised
    map paper; grab a; 0.4; say a; arm gripper=closed; lift a; 0.2; close a >
    close_gripper
never: a hold ends by two pokes
    map paper; arm hold; 1; double_pat a. > !next_waypoint [the arm is held: test; to
    go on: poke, 1 s later poke]; 1; poke b. > pause; 1; poke c. > resume; ? at work
confidence: poke needs 0.34
    poke a 0.35. > pause; poke b 0.33. > !pause [below 34%]
confidence: so does what asks
    grab a 0.33. > !next_waypoint [grab (33%) is below 34%; do it again]; 1; grab b
    0.35. >; ? shows_question=1
confidence: rule raises it
    map stroke_on; stroke a 0.96. > !next_waypoint [below 97%]
confidence: rule lowers it
    map pat_low; double_pat a 0.1.; ? shows_question=1
confidence: doubtful touch becomes confident until it closes
    map stroke_on; stroke a 0.85; 0.4; say a >; lift a; 0.4; a is 0.98; 0.02; close a
    >; ? shows_question=1
confidence: confidence may fall until it closes
    {asked} lift a; 0.4 >; a is 0.33; 0.02; close a > !resume [not understood: grab
    (33%) is below 34%; do it again, more clearly]
confidence: doubtful stop may become sure
    poke a 0.3; 0.1; say a >; a is 0.4; 0.02 > pause
unknown: likely stop halts
    none a; 0.2; lift a; say a unknown 0.35 likely=poke; > pause [most likely poke
    (35%): it may be a stop (35%)]; ? paused
unknown: unlikely stop does not
    none a; 0.2; say a unknown 0.33 likely=poke > !none
unknown: likely stroke slows
    none a; 0.2; say a unknown 0.5 likely=stroke; close a > slow
unknown: unlikely stroke does not
    none a; 0.2; say a unknown 0.48 likely=stroke > !none
unknown: likely grab asks
    {paused} none a; 0.2; lift a; 0.4; say a unknown 0.6 likely=grab; close a >; ?
    shows_question=1
unknown: one that is not likeliest at its end does not
    {paused} none a; 0.2; lift a; 0.4; say a unknown 0.4 likely=grab; 0.02; close a >
    !resume [not understood]
unknown: likely nothing is nothing
    none a; 0.2; say a unknown likely=none; none b; 0.2; say b unknown >
unknown: its latest chance counts
    poke a 0.4; 0.02; say a unknown 0.5 likely=double_pat > pause [most likely
    double_pat (50%):
    it may be a stop (40%)]
unknown: never resumes
    {paused} poke a; 0.2; lift a; say a unknown 0.9 likely=poke > !none; 1; close a >;
    ? paused
unknown: stale one does not halt
    none a; 0.2; say a unknown 0.4 age=0.12 likely=poke > !pause [120 ms]
once: touch commands once
    stroke a; 0.4; say a; 0.02 > slow; 0.6; say a > !slow [commanded already]
once: its heir commands nothing
    stroke a; 0.4; double_pat b; 0.02; say a; 0.02 > slow; merge a b; 1; say b >
    !close_gripper [commanded already]; lift b
once: nor the heir of one that asks
    grab a; double_pat b; 0.02; say a; merge a b; say b > !close_gripper [commanded
    already]; 0.3; lift b; 0.5; close b > !next_waypoint [not understood]
once: but the heir of one that asks may stop the arm
    grab a; 0.2; say a; poke b; 0.1; merge a b; say b > pause; lift b; 0.4; close b >
    !next_waypoint
once: touch that paused as unknown
    none a; 0.2; say a unknown likely=poke > pause; say a poke > !pause [commanded
    already]
once: touch that stopped the arm
    none a; 5.1 > pause [5.0 s]; say a poke > !pause [commanded already]
once: two that ask and merge are both refused
    {closed} grab a; double_pat b; 0.4; say a; say b; merge a b > !next_waypoint
    [commanded already], !open_gripper [commanded already]; lift b; 0.5; close b >
once: contact that never ends commands again with a new onset
    stroke a; 0.4; say a; 0.02 > slow; a begins again; 0.4; a is poke; say a > pause
once: rule rests after a command
    map resting_slow; stroke a. > slow; stroke b. > !slow [s ago, it rests 60 s]
once: a stop needs no rest
    map resting; poke a. > pause; 1; ask double_pat > resume; poke c. > pause
time: more is done once the hand has left and the touch has closed
    map paper; double_pat a; 0.5; say a; 0.5; lift a; 0.48 >; close a > next_waypoint
time: less is done at once
    stroke a; 0.1; say a; 0.02 > slow
time: bump may make it do less
    stroke a; 0.1; say a; lift a; 0.3 > slow; poke b; 0.1; say b > pause
time: touch that goes on for long may ask
    {asked} 4; lift a; 0.48 >; close a >; ? shows_question=1
time: one that presses on for more than a second after its end does not
    {asked} lift a; none b 0.1N; 0.5; close a > !resume [touched again]
time: stale detection
    poke a; 0.02; say a age=0.12 > !pause [it was felt 120 ms ago]
time: pause of a second
    poke a; 0.02; say a > pause; lift a; 0.5; close a; 0.44; grab b; 0.02; say b >
    !resume [arm moved]; ? paused; lift b; 0.5; close b; 0.98; ask
    grab > resume
time: any contact restarts it
    {paused} none a 0.1N; 0.02; lift a; close a; 0.94; grab b. > !resume [1 s before];
    1; ask grab > resume
time: so does one that goes on meanwhile
    {paused} none a; 0.1; lift a; 0.1; grab b; 0.4; say b > !resume; lift b; 0.5
time: a hand that is there already counts, however long it has been there
    {paused} none a; 3; grab b; 0.4; say b > !resume [touched]; lift a; lift b; 0.5
time: also where the touch that asks begins anew
    {paused} none a; 3; grab b; 0.1; grab c; merge b c; 0.4; say c > !resume
    [touched]; lift a; lift c; 0.5
time: fingers that land together are one hand
    {paused} none a; grab b; 0.4; say b; lift a; lift b; 0.4; close a; close b >; ?
    shows_question=1
time: touch before the pause
    double_pat a; 0.1; poke b; 0.02; say b > pause; 1.5; say a grab > !resume [arm
    moved]; ? paused
time: pause once more counts
    {asked} arm resume; arm pause; 0.2; lift a; 1.2; close a > !resume [arm moved];
    ? paused
time: touch before a hold
    {asked} arm hold; 0.2; lift a; 1.2; close a > !resume [arm moved]; ? held
time: arm that runs
    grab b; 0.4; say b; arm pause; lift b; 0.2 > !next_waypoint [arm moved]
time: toggle that would do the opposite
    {closed} double_pat a 0.8; 0.2; say a; arm gripper=open; 0.02 > !open_gripper [the
    arm
    has changed: the same would close gripper now]
answer: arm stands while it asks
    grab a. >; ? speed_limit=0; ? at work; 0.5; poke b. >; 0.3 >
    next_waypoint; 0.02; ? speed_limit=1; ? shows_question=
answer: none comes
    {asks} 0.98 >; 0.06 > !resume [no poke answered; let go, and ask again 5 s later];
    ? paused; ? shows_question=
answer: arm at work goes on as before
    grab a. >; 1.06 > !next_waypoint; ? at work; ? speed_limit=1
answer: too soon
    {asks} 0.22; poke b 0.3; 0.02 > !resume [touched before the arm had asked]
answer: within the window
    {asks} 0.28; poke b.; 0.3 > resume
answer: to its end
    {asks} 0.96; poke b.; 0.3 > resume
answer: by another gesture
    {asks} 0.5; stroke b; 0.3; lift b; 0.4; say b >; close b > !resume [no clear poke];
    0.02 > slow; ? paused
answer: by the gesture that asked
    {asks} 0.5; grab b. > !resume [no clear poke], !resume [after a question]
answer: by a poke that is as clear as one that stops
    {asks} 0.5; poke b 0.35.; 0.3 > resume
answer: by one that is not
    {asks} 0.5; poke b 0.33. > !resume [no clear poke (33%)]; 0.02 > !pause
answer: as briefly as things hit
    {asks} 0.5; poke b; 0.1; lift b; 0.4; close b > !resume [the answer was brief (0.08
    s), as a hit may be]
answer: on another link
    {asks} 0.5; poke b elsewhere; 0.2; lift b; 0.4; close b > !resume [not on
    forearm_link]
answer: that was detected as another gesture may be clear at its end
    {asks} 0.5; poke b; 0.2; lift b; 0.3; say b unknown likely=poke >; close b >; 0.4 >
    resume
answer: that stays
    {asks} 0.5; poke b; 1.48 >; 0.06 > !resume [lasted for more than 1.5 s]
answer: of which something presses on
    {asks} 0.5; poke b; 0.3; lift b; 0.3; press b; 0.2 >; 0.8 > !resume [lasted]
answer: too strong
    {asks} 0.5; poke b 41N; 0.02 > !resume [the answer was too strong (touch of 41 N)]
answer: two hands
    {asks} 0.5; poke b; 0.1; poke c; 0.02 > !resume [more than one touch]
answer: another touch just after it
    {asks} 0.5; poke b.; 0.1; poke c; 0.02 > !resume [more than one touch], pause
answer: one hand that presses two places
    {asks} 0.5; poke b; 0.1; lift b; 0.1; poke c; 0.02 > !resume [more than one touch]
answer: another asks again only after five seconds without a touch
    {asks} 1.1 > !resume; 4.5; grab b. > !resume [after a question]; 4.4; ask
    grab > !resume [after a question], pause; 5; ask grab > resume
answer: that fails to answer stops an arm at work
    grab a. >; 0.1; poke b. > !next_waypoint [before the arm had asked], pause; ? paused
answer: also where it was not understood
    grab a. >; 0.3; poke b 0.4; 0.3; lift b; 0.4; say b unknown 0.4 likely=poke; close b
    >; 0.1; none c; 0.02 > !next_waypoint [more than one], pause
answer: that begins anew as it lands
    {asks} 0.5; poke b 0.3N; 0.16; poke c; merge b c; 0.3; lift c; 0.4; close c >; 0.4 >
    resume
answer: pause meanwhile
    grab a. >; arm pause; 0.02 > !next_waypoint [arm moved]
answer: hold meanwhile
    {asks} arm hold; 0.5; poke b. > !resume [arm moved], pause; ? held
answer: skin that is silent meanwhile
    {asks} gap 0.12 > !resume [stale skin], hold; ? shows_question=
answer: end of the stream meanwhile
    {asks} end; ? shows_question=; ? held
answer: touch that asks may be strong, since it is over when the arm asks
    {asked} a is 60N; 0.1; a is 5N; lift a; 0.48; close a >; ? shows_question=1; 0.5;
    poke b.; 0.3 > resume
several: of two that ask at once one does
    {paused} grab a; grab b; 0.4; say a; say b; lift a; lift b; 0.4; close a >; close b
    > !resume [another touch]; ? shows_question=1
several: touch again
    {asked} lift a; 0.2; poke b 0.05; 0.2 > !resume [touched again]; lift b; close a;
    0.5 >; ? paused
several: earlier touch goes on
    {paused} grab a; poke b 0.05; 0.4; say a; lift a; 0.48; close a >; ?
    shows_question=; lift b; 0.3; close b >; ? shows_question=1
several: for more than a second
    {paused} grab a; poke b 0.05; 0.4; say a; lift a; 0.48; close a >; 0.6 > !resume
    [something still presses]
several: no command under a hand that is there
    none b; 0.1; grab a; 0.4; say a > !next_waypoint [touched]; lift a; lift b; 0.5
several: heir asks instead
    {asked} lift a; grab b; lift b; merge a b; 0.2 >; close b >; ? shows_question=1
several: patch that sends nothing is not let go
    {asked} lift a; 0.46; patch silent; 0.02; close a >; ? shows_question=; patch well;
    0.02 >; ? shows_question=1
several: touch whose end was dropped has ended
    {asked} lift a; 0.46; lose a; 0.02 >; ? shows_question=1
several: so has one elsewhere
    poke p. > pause; 1; grab a; none b; 0.1; lose b; 0.3; say a; lift a; 0.5; close a
    >; ? shows_question=1
several: and nobody waits for it
    poke a 0.4; 0.02; ? speed_limit=0; lose a; 0.02 > pause [may have been a stop]
several: orders of two
    map paper; double_pat a; poke b; 0.4; say a; say b > pause; lift a; lift b; 0.2;
    close b; close a > next_waypoint
suspended: any touch suspends
    none a; 0.02; ? speed_limit=0; lift a; close a >; 0.02; ? speed_limit=1; ? at work
suspended: until it has closed, whatever it is
    double_pat a; 0.02; ? speed_limit=0; say a none; 0.02; ? speed_limit=0; lift a;
    0.3; ? speed_limit=0; close a >; 0.02; ? speed_limit=1
suspended: while what it asks for is open
    grab a; 0.2; say a; lift a; 0.3; ? speed_limit=0; close a >; ? speed_limit=0
suspended: end of a likely stop pauses
    poke a 0.4; 0.02; lift a; close a > pause [not understood: the touch may have been
    a stop]; 0.02; ? speed_limit=1
suspended: heir is waited for
    poke a 0.1; none b; 0.02; merge a b; lift b; 0.02; ? speed_limit=0; say b; close b;
    0.02; ? speed_limit=1
suspended: stopped arm waits for none
    {paused} poke a 0.4; 0.02; ? speed_limit=1; lift a; close a >
suspended: long touch pauses
    none a; 4.9 >; 0.2 > pause [touch for 5.0 s]; ? paused
suspended: so does an unknown one
    none a; 0.02; say a unknown; 5.1 > pause
suspended: long touch that was nothing
    none a; 3; lift a; 0.5; ? speed_limit=0; say a; close a >; 0.02; ? speed_limit=1
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
    double_pat a 10N; a is full; 0.4; say a; 0.1; lift a; 0.4; close a >; ?
    shows_question=1
suspended: resting arm is not held
    arm at_work=; arm speed_limit=1; none a 20N; 3 >; ? at work
suspended: strong touch holds a suspended arm
    none a; 0.2; ? speed_limit=0; none b 60N; 0.02 > hold [60 N]
suspended: tap recognises no press beside it
    none a 15N; grab b; 0.2; say b; merge b a; a is 60N; 0.02 > hold,
    !next_waypoint
suspended: light touch that lasts slows
    none a 1.1N; 6 > pause [5.0 s]; 4.1 > !none [patch 'forearm_back' has been touched
    for more than 10 s]; arm resume; 3 > slow [a light touch on patch 'forearm_back'
    lasts for more than 10 s]; ? at work; ? speed_limit=0.3; lift a; close a; 1.8 >;
    0.2 > normal [the cause is over (a light touch]; ? speed_limit=1
suspended: but no touch starts the arm under it
    none a 1.1N; 11 > pause, !none; grab b. > !resume [touched]; lift a; close a; 1;
    ask grab > resume
suspended: until it is strong
    none a 1.1N; 11 > pause, !none; arm resume; 0.02 > slow; a is 5N; 0.02 > pause
    [touch for]
suspended: or another has become part of it
    none a 1.1N; 11 > pause, !none; arm resume; 0.02 > slow; none b; 0.1; ?
    speed_limit=0; merge b a; 0.02 > pause [touch for]
suspended: a light touch that begins anew
    none a 0.4N; 0.1; none b 1.9N; merge a b; 0.1; ? speed_limit=0
suspended: touch ends a jog
    map jog; {paused} ask stroke > jog; 0.6; none b; 0.02 > pause [touched while it
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
    speed_limit=0.3; 0.3 > normal [the cause is over (broken skin]; ? speed_limit=1; ?
    speed=0.5
skin: few lost readings
    0.2; patch silent; 0.08; patch well; 0.02; patch silent; 0.08; patch well; 0.02 >;
    ? speed_limit=1
skin: end of a fault offers
    patch silent; 1 > slow, hold; double_pat a; 0.3; say a > !close_gripper [is out;
    see to
    its cable]; close a; patch well; 0.02 > !resume [the cause is over (broken skin:
    patch 'forearm_back' is out); to go on: poke, 1 s later grab, then poke when the arm
    asks]; double_pat b. > !close_gripper [is still held, though the cause is over
    (broken skin]; poke c. > pause; 1; ask grab > resume, normal; ? at work
skin: end of a fault starts nothing
    {paused} patch silent; 5 > hold; patch well; 5 > !resume [to go on: grab]; ?
    held
arm: protective stop
    arm protective_stop=1; poke a. > !pause [protective stop]; double_pat b. >
    !close_gripper [unlock it]
arm: program has ended
    arm running=; poke a. > !pause [program has ended]; stroke b. > !slow [start the
    command again]
arm: no connection
    arm connected=; poke a. > !pause [not connected]; stroke b. > !slow [see to its
    cable]
arm: held arm takes a pause, and a start that is answered
    arm hold; grab a. > !next_waypoint [the arm is held: test; to go on: poke, 1 s
    later grab, then poke when the arm asks]; stroke s. > slow; poke b. > pause; ?
    held; 1; ask grab > resume; ? at work; ? speed_limit=1
arm: running arm is not resumed
    map resting; double_pat a. > !resume [nobody has paused it; to go on: poke, 1 s
    later double pat, then poke when the arm asks]
arm: arm that stays held
    arm hold; poke a. > pause; 1; arm error=arm; ask grab > hold [lost], !resume
    [lost]; ? held; ? paused=1
arm: jog
    map jog; {paused} ask stroke > jog; ? paused; ? jogging=1
arm: further jogs are not asked for
    map jog; {paused} ask stroke > jog; arm jogging=; 1; stroke b. > jog; ?
    paused
arm: but after twenty seconds they are
    map jog; {paused} ask stroke > jog; arm jogging=; 20; stroke b. >; ?
    shows_question=1
arm: and after another pause
    map jog; {paused} ask stroke > jog; arm jogging=; 0.5; poke b. > pause; 1; stroke
    c. >; ? shows_question=1
arm: and after any pause
    map jog; {paused} ask stroke > jog; arm jogging=; arm pause; 1; stroke b. >; ?
    shows_question=1
arm: jog of a running arm
    map jog; stroke a. > !jog [nobody has paused it]
arm: jog nowhere
    map jog; {paused} stroke a; a goes nowhere; 0.4; say a > !jog [did not travel]
arm: jog of a held arm
    map jog; {paused} arm hold; stroke a. > !jog [held: test]
arm: jog out of reach
    map jog; {paused} arm error=jog; ask stroke > !jog [no jog]; ? paused
arm: jog that fails
    map jog; {paused} arm error=arm; ask stroke > hold [lost], !jog [lost]; ? held
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
        self.scene.wait(1.0)
        self.numbers = {}
        self.seen = 0

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
            case ["press", name]:
                scene.close(self.numbers[name], is_held=True)
            case ["ask", gesture]:
                for step in (f"{gesture} asking.", "0.5", "poke answering.", "0.3"):
                    self.play(step)
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
                touch.onset = self.scene.clock.now() + PERIOD
                touch.pressed = True
            elif word == "elsewhere":
                touch.taxels = SKIN.find_taxels(OTHER_PATCH.id)[:4]
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
            arm.hold(HELD)
        elif key == "error":
            arm.error = ERRORS[value]
        elif equals:
            kind = type(getattr(arm, key))
            setattr(arm, key, kind(value))
        else:
            getattr(arm, key)()

    def compare(self, decisions):
        """Compare the decisions since the last comparison."""
        events = self.scene.events[self.seen :]
        self.seen = len(self.scene.events)
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
