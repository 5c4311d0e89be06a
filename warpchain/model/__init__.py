"""Derivation from a drive: its chains, bodies and trains, sizes, stiffnesses, speeds; and stacks of drives."""
