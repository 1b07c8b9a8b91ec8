// Nothing: its target has the precompiled headers of the unit tests.
