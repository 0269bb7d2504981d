"""What is kept on disk for all processes: files of arrays that are mapped, checked before they are trusted, bounded."""
