"""Agents that learn in the environments, and policies that leave as components."""
