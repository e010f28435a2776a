"""How sharply each photograph shows the scene, and photographs made equally sharp."""
