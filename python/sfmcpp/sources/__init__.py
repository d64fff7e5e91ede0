"""Where data comes from: files (`io`), images (`vision`), drives, scenes with known truth (`synthetic`)."""
