"""`python -m ruptfx`, and at its end the processor time of its phases on rank 0 as JSON; imports nothing of its own."""

import json
import runpy

from ruptfx import fem
from ruptfx.stopwatch import phases

if __name__ == "__main__":
    try:
        runpy.run_module("ruptfx", run_name="__main__")
    except SystemExit as ended:
        if ended.code:
            raise
    if fem.MPI.COMM_WORLD.rank == 0:
        print(json.dumps(phases()))
