"""Measurements that anyone can repeat: how well the methods do on data whose answer is known."""
