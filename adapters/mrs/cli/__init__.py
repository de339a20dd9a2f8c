"""The sub-commands of `rover` that speak the MRS."""
