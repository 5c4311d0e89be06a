"""Partners of one variant's contacts on the CPU: sprockets and guides that its rollers touch."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..physics.guide import carried_guide
from ..structs import GROUND, Drive, Pose, types


@dataclass(frozen=True)
class PartnerFunctions:
    """CPU contact partner functions."""

    Partner: Any
    sprocket_partner: wp.Function
    guide_partner: wp.Function
    partner_at: wp.Function
    law_of_partner: wp.Function
    friction_of_partner: wp.Function
    carrier_of_partner: wp.Function
    widened_partner: wp.Function


@cache
def partner_functions(Real: type) -> PartnerFunctions:
    """CPU contact partner functions."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.struct
    class Partner:
        """A sprocket, or a guide where `teeth` is 0, and its body's pose."""

        teeth: wp.int32
        points: wp.int32  # contacts of a pin with it (`structs.Drive`)
        body: wp.int32  # of the drive, or `GROUND`
        pose: Pose
        sprocket: kinds.Sprocket
        guide: kinds.Guide

    @wp.func
    def sprocket_partner(ensemble: Ensemble, state: State, drive: Drive, s: int):
        """Sprocket `s` of a drive as a contact partner, at its pose."""
        partner = Partner()
        partner.teeth = 1
        partner.points = drive.points
        partner.body = s
        partner.pose = state.poses[drive.first_body + s]
        partner.sprocket = ensemble.sprockets[drive.first_sprocket + s]
        return partner

    @wp.func
    def guide_partner(ensemble: Ensemble, state: State, drive: Drive, g: int):
        """Guide `g` of a drive as a contact partner, at its pose."""
        partner = Partner()
        bar = ensemble.guides[drive.first_guide + g]
        partner.points = 1
        partner.body = bar.body
        partner.pose.cosine = wp.float64(1.0)
        if bar.body != GROUND:
            partner.pose = state.poses[drive.first_body + bar.body]
            if bar.pieces == 0:
                now = carried_guide(bar, partner.pose)
                bar.start = now.start
                bar.direction = now.direction
        bar.first_piece = drive.first_piece + bar.first_piece
        partner.guide = bar
        return partner

    @wp.func
    def partner_at(ensemble: Ensemble, state: State, drive: Drive, p: int):
        """Partner `p` of a drive's contacts: its sprockets, then its guides."""
        if p < drive.sprockets:
            partner = sprocket_partner(ensemble, state, drive, p)
            return partner
        partner = guide_partner(ensemble, state, drive, p - drive.sprockets)
        return partner

    @wp.func
    def law_of_partner(ensemble: Ensemble, drive: Drive, p: int):
        """Contact law of partner `p` of a drive."""
        if p < drive.sprockets:
            law = ensemble.sprockets[drive.first_sprocket + p].law
            return law
        law = ensemble.guides[drive.first_guide + p - drive.sprockets].law
        return law

    @wp.func
    def friction_of_partner(ensemble: Ensemble, drive: Drive, p: int):
        """Friction of contact partner `p` of a drive."""
        if p < drive.sprockets:
            friction = ensemble.tooth_friction[drive.first_sprocket + p]
            return friction
        friction = ensemble.guide_friction[drive.first_guide + p - drive.sprockets]
        return friction

    @wp.func
    def carrier_of_partner(ensemble: Ensemble, drive: Drive, p: int):
        """Body that carries contact partner `p` of a drive, or `GROUND`."""
        body = p
        if p >= drive.sprockets:
            body = ensemble.guides[drive.first_guide + p - drive.sprockets].body
        return body

    @wp.func
    def widened_partner(partner: Partner, skin: Real):
        """Contact partner widened by `skin` [m]."""
        far = wp.sqrt(partner.sprocket.far_square) + skin
        near = wp.max(wp.sqrt(partner.sprocket.near_square) - skin, Real(0.0))
        partner.sprocket.far_square = far * far
        partner.sprocket.near_square = near * near
        if near == Real(0.0):
            partner.sprocket.near_square = Real(-1.0)
        partner.guide.end_radius += skin
        partner.guide.roller_radius += skin
        apart = wp.vec2d(wp.float64(skin), wp.float64(skin))
        partner.guide.low = partner.guide.low - apart
        partner.guide.high = partner.guide.high + apart
        return partner

    return PartnerFunctions(
        Partner=Partner,
        sprocket_partner=sprocket_partner,
        guide_partner=guide_partner,
        partner_at=partner_at,
        law_of_partner=law_of_partner,
        friction_of_partner=friction_of_partner,
        carrier_of_partner=carrier_of_partner,
        widened_partner=widened_partner,
    )
