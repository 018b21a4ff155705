"""What the user touches: command line, pictures and report."""
