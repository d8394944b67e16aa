"""The appearance of the window: colors, theme, icons, labels, notices, hints. Independent of documents."""
