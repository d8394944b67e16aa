"""Files that anybody may have made, and files that nobody may lose: opened, read, written and locked so that a link, a
pipe, a bomb, a full disk or a kill does no harm. Knows no format but images, arrays and SQLite."""
