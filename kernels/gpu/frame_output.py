"""Frames of one variant on a block: where they begin, and output of bodies and couplings."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..frames import frame_writer_functions
from ..structs import Drive
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .events import FRAME


@dataclass(frozen=True)
class FrameOutputFunctions:
    """Frame output functions of a block."""

    frame_begin: wp.Function
    write_body: wp.Function
    write_coupling: wp.Function


@cache
def frame_output_functions(kind: BlockKind, frame: Any) -> FrameOutputFunctions:
    """Frame output functions of block kernels, and frames of layout `frame` (`kernels.frames`)."""
    Real = kind.Real
    sprockets, rotors = kind.parts.sprockets, kind.parts.rotors
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State = kinds.Ensemble, kinds.State
    vec2 = kinds.vec2
    frame_writers = frame_writer_functions(Real, frame)
    chains = chain_functions(kind)

    @wp.func
    def frame_begin(drive: Drive, now: Now):
        """Index at which the frame of a block's step begins in the buffer."""
        every = drive.frame_interval
        number = now.step // every - (now.frames_begun + every - 1) // every
        return int(drive.first_value) + number * frame_writers.drive_width(drive)

    @wp.func
    def write_body(
        ensemble: Ensemble,
        state: State,
        frames: wp.array[Real],
        mine: ThreadParts,
        now: Now,
        body: kinds.Instant,
        moment: Real,
        force: vec2,
    ):
        """Writes the thread's body and its tensioners to a due frame; chain's moment [N m] and force [N]."""
        if now.flags & FRAME != 0:
            drive = ensemble.drives[mine.drive_row]
            at = frame_begin(drive, now)
            if mine.sprocket >= 0:
                frame_writers.write_sprocket(frames, at, drive.rollers, mine.body_number, body, moment, force)
            if wp.static(kind.parts.arms):
                if mine.arm >= 0:
                    frame_writers.write_arm(
                        frames, at, drive, mine.body_number - (drive.bodies - drive.arms), body, moment
                    )
            for t in range(chains.tensioner_count(drive)):
                if ensemble.tensioners[drive.first_tensioner + t].body == mine.body_number:
                    frame_writers.write_tensioner(frames, at, drive, t, state.pushes[drive.first_tensioner + t])
            if wp.static(kind.parts.is_tied):
                if mine.body >= sprockets and mine.body < rotors:
                    frame_writers.write_shaft(frames, at, drive, mine.body_number - drive.sprockets, body)

    @wp.func
    def write_coupling(
        ensemble: Ensemble,
        frames: wp.array[Real],
        mine: ThreadParts,
        now: Now,
        c: int,
        twist: Real,
        moment: Real,
    ):
        """Writes coupling c of all to the block's frame."""
        drive = ensemble.drives[mine.drive_row]
        at = frame_begin(drive, now)
        frame_writers.write_coupling(frames, at, drive, c - drive.first_coupling, twist, moment)

    return FrameOutputFunctions(
        frame_begin=frame_begin,
        write_body=write_body,
        write_coupling=write_coupling,
    )
