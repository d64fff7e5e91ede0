"""Where data comes from: files (`io`), images (`vision`) and scenes with known truth (`synthetic`)."""
