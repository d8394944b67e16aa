"""Opens, reads, writes and locks untrusted files safely: links, pipes, decompression bombs, full disks and kills do no
harm. Independent of file formats except images, arrays and SQLite."""
