"""The command `strandline`. Heavy modules are imported by the commands that need them, so that help is instant."""

import typer

from service.commands import checks, client, info, picture, run, serve

main = typer.Typer(
    name="strandline", no_args_is_help=True, pretty_exceptions_show_locals=False, rich_markup_mode="markdown",
    help="Simulates yarns that slide on each other, strands and liquids: a scene in, a browser view, a recording, and a report "
         "of speed against error out. `strandline demo` shows all of it.")
main.command()(run.run)
main.command()(serve.serve)
main.command()(serve.demo)
main.command()(serve.view)
main.command()(picture.picture)
main.command()(client.submit)
main.command()(client.jobs)
main.command()(client.show)
main.command()(client.cancel)
main.command()(client.fetch)
main.command()(checks.validate)
main.command()(checks.bench)
main.command()(info.schema)
main.command()(info.scenes)
main.command()(info.doctor)

if __name__ == "__main__":
    main()
