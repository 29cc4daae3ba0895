"""Where a mechanism loses or gains freedom."""
