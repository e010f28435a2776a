"""Windows of several panes, or tinted ones: how likely they are, and where gaps lie."""
