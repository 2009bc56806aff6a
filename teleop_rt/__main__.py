"""`python -m teleop_rt`: the command line."""

from teleop_rt.cli import main

if __name__ == "__main__":
    main()
