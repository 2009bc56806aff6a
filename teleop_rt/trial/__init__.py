"""A trial: one run of slave, master and rig by one file, into one folder.

`run_processes` runs it on the machine's clock, each side in a process whose main is in
`process_main`; `lockstep_run` runs it in one process on simulated time. Both build the same slave
and master (`sides`, `master_side`). `folder` holds a trial's files, `summary` the figures
of its recording.
"""
