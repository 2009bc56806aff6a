"""Tools for developers: generators, plants, hands, faults, benches, campaigns, documentation.

No part of the wheel. Tests and the commands of `scripts/` use it; nothing that is shipped does.
"""
