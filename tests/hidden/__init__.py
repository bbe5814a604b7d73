"""The product on records of the independent worlds: does it name what was hidden, and nothing else?"""
