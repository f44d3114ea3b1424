"""Pictures: report, plots and viewer; nothing else imports meshcat."""
