"""`python -m sim.fork` is `rover whatif`, for processes that do not import the simulation."""

from sim.fork.commands import whatif

if __name__ == "__main__":
    whatif(prog_name="rover whatif")
