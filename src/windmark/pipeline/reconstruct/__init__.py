"""Files of a reconstruction: pictures, primaries and labels in, tables and poses out; `tasks.reconstruct` does it."""
