"""Opens, reads, writes and locks files, which anybody may have made, so that a link, a pipe, a decompression bomb, a
full disk or a kill does no harm. Knows no format but images, arrays and SQLite."""
