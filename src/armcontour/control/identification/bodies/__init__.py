"""Identification of an arm with masses and its drives; uses the nominal robot of `drives`."""
