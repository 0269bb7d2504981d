"""What machines and strangers do to a program: corrupted files, kills, full disks, time. Counts what does not hold."""
