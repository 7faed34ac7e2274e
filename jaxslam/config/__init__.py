"""All settings: configurations, lidar presets, TOML and dotted names. No algorithm is defined here."""
