"""What a picture is of: values, checked, and their TOML."""
