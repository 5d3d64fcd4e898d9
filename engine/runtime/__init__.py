"""Used by every room: errors, files and locks, checked input, memory, threads, frozen values."""
