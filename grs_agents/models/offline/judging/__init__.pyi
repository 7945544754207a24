from .judge import judge_words as judge_words
