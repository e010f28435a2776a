"""Windows of several panes, or tinted ones: how likely they are, where gaps lie, and the search for them."""
