"""Example drives, as TOML files."""
