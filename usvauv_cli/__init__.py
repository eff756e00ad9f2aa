"""What a person types and looks at: commands, video, tables."""
