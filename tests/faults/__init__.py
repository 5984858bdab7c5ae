"""Random faults of a room's code, built in asleep and woken in forks."""
