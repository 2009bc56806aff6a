"""Who answers on a bus or a line: ids and identities, asked without moving anything."""
