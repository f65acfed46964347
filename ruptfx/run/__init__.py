"""One run: the semi-discrete model, the only time loop, stages, recorded files, cost."""
