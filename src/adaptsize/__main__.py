"""``python -m adaptsize``: the same as the command ``adaptsize``."""

if __name__ == "__main__":
    try:
        from adaptsize.cli import main
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    main()
