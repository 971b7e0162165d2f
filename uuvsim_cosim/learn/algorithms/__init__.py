"""The learners: PPO, DQN, SAC and MASAC, and what they share.

It may import `learn.policies`, `learn.shared`. Start reading with `registry.py`, then `ppo.py`.
"""
