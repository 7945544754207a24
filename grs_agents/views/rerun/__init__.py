"""The rerun recording of a run. Importing its modules imports rerun, which is slow."""
