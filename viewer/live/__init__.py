"""A scene while it changes: jobs in a worker, drafts, and its error."""
