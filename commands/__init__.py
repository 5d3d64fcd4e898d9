"""The subcommands of `lensfield`, one module each: parse, call the engine or the add-on, report the result."""
